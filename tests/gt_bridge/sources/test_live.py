"""Live people_msgs/People: CDR bytes, good and bad, and the complete way over Zenoh."""

import os
import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
import zenoh

from common.io.ros_bag import PEOPLE
from common.transport.zenoh_bus import read_config
from people4d.errors import ConfigError, DecodeError
from people4d.messages import Health, Score, Truth
from services.gt_bridge.config import FixedTransform, GtBridgeConfig
from services.gt_bridge.node import GtBridgeNode
from services.gt_bridge.sources.registry import open_truth
from services.gt_bridge.sources.ros import LiveTruth, people_typestore
from tests.gt_bridge.scene import POSE, track, tracks, truth
from tests.network import WAIT_S, Network, Watcher

pytestmark = [pytest.mark.processes, pytest.mark.network]

STORE = people_typestore()
SOURCE = LiveTruth(GtBridgeConfig(truth="zenoh:vicon/people"))


def cdr(stamp_ns: int, x: float, name: str = "anna", frame_id: str = "map") -> bytes:
    """One person as zenoh-bridge-ros2dds passes them on: the bytes of DDS."""
    types = STORE.types
    point, stamp = types["geometry_msgs/msg/Point"], types["builtin_interfaces/msg/Time"]
    person = types["people_msgs/msg/Person"](
        name=name,
        position=point(x=x, y=0.0, z=1.0),
        velocity=point(x=0.5, y=0.0, z=0.0),
        reliability=1.0,
        tagnames=["yaw_rad"],
        tags=["0.25"],
    )
    header = types["std_msgs/msg/Header"](
        stamp=stamp(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9), frame_id=frame_id
    )
    return bytes(STORE.serialize_cdr(types[PEOPLE](header=header, people=[person]), PEOPLE))


def test_cdr_by_hand() -> None:
    # Encapsulation 0001 (little-endian), stamp 5 s + 7 ns, frame "map", no people.
    payload = bytes.fromhex("00010000 05000000 07000000 04000000 6d617000 00000000")
    got = SOURCE.decode(payload)
    assert isinstance(got, Truth)
    assert (got.stamp_ns, got.frame_id, got.people) == (5_000_000_007, "map", ())


def test_a_person_with_yaw() -> None:
    got = SOURCE.decode(cdr(5, 2.0))
    assert isinstance(got, Truth)
    (person,) = got.people
    assert (person.id, person.yaw_rad) == ("anna", 0.25)
    assert person.position_m.tolist() == [2.0, 0.0, 1.0]


def test_the_key_is_the_topic_without_its_slash() -> None:
    for text in ("zenoh:vicon/people", "zenoh:/vicon/people"):
        truth_ = open_truth(GtBridgeConfig(truth=text))
        (topic,) = GtBridgeNode(truth_, GtBridgeConfig(truth=text)).foreign_inputs
        assert topic.key_expression("robot") == "vicon/people"
    for key in ("", "/", "a//b", "a/*", "**", "a/$*", "a?x=1", "a#b", "a\0b", "a b", "x/" * 99):
        text = f"zenoh:{key}"
        with pytest.raises(ConfigError, match=r"is not a key\. Write zenoh: and the ROS topic"):
            open_truth(GtBridgeConfig(truth=text))


def test_bad_bytes_raise_nothing_but_decode_error() -> None:
    good = cdr(5, 2.0)
    rng = random.Random(7)
    bad = [good[:n] for n in range(len(good) - 4)]
    bad += [bytes(rng.randbytes(rng.randrange(300))) for _ in range(500)]
    for _ in range(2000):
        damaged = bytearray(good)
        damaged[rng.randrange(len(good))] = rng.randrange(256)
        bad.append(bytes(damaged))
    tracked = []
    for payload in bad:
        try:
            assert isinstance(SOURCE.decode(payload), Truth)  # some damage is another number
        except DecodeError as error:
            tracked.append(str(error))
    assert len(tracked) > 500
    assert max(map(len, tracked)) < 300


def test_a_message_without_time_and_a_huge_one_are_refused() -> None:
    with pytest.raises(DecodeError, match=r"header\.stamp, got 0"):
        SOURCE.decode(cdr(0, 2.0))
    with pytest.raises(DecodeError, match="at most 1048576 bytes"):
        SOURCE.decode(b"\x00\x01\x00\x00" + bytes(2**20))


def node(**settings: Any) -> GtBridgeNode:
    config = GtBridgeConfig(truth="zenoh:vicon/people", **settings)
    return GtBridgeNode(open_truth(config), config)


def test_the_node_waits_for_its_key_without_complaint() -> None:
    live = node()
    assert (live.status().state, live.status().reason) == ("ready", "waits for vicon/people")
    live.handle(truth(100), 0)
    assert live.status().reason == ""


def test_captured_truth_goes_out_at_once_with_its_offset() -> None:
    (got,) = node(offset_s=0.5).handle(truth(100), 0)
    assert got.stamp_ns == 600_000_000


def test_captured_truth_that_comes_late_is_counted() -> None:
    live = node()
    assert len(live.handle(truth(5000), 0)) == 1
    assert live.handle(truth(4990), 0) == []
    assert live.handle(truth(5000), 0) == []  # the same again
    assert live.status().counters["late_truth"] == 2
    assert len(live.handle(truth(1000), 0)) == 1  # from well before: the capture began again


def test_the_chain_from_mocap_over_the_camera_to_the_map() -> None:
    # Motion capture measured the camera's body 2 m along its own x, turned by 180 degrees about z.
    # In the map the camera is at the origin, so mocap's x = 5 is at x = 2 - 5 = -3.
    calibrated = FixedTransform(
        parent="vicon", child="front_link", xyz_m=(2.0, 0.0, 0.0), rpy_rad=(0.0, 0.0, np.pi)
    )
    live = node(transforms=(calibrated,), truth_frame="vicon")
    captured = LiveTruth(GtBridgeConfig(truth="zenoh:x")).decode(cdr(5, 5.0))
    (raw,) = live.handle(captured, 0)
    assert isinstance(raw, Truth)
    assert raw.frame_id == "vicon"  # the camera has not tracked yet where it is
    assert live.status().state == "degraded"
    assert "no transform map <- vicon" in live.status().reason
    assert live.status().counters["unlinked"] == 1

    live.handle(POSE, 0)
    (got,) = live.handle(LiveTruth(GtBridgeConfig(truth="zenoh:x")).decode(cdr(6, 5.0)), 0)
    assert isinstance(got, Truth)
    assert got.frame_id == "map"
    (person,) = got.people
    assert person.position_m == pytest.approx([-3.0, 0.0, 2.0])  # the camera is 1 m up
    assert person.velocity_mps == pytest.approx([-0.5, 0.0, 0.0])
    assert person.yaw_rad == pytest.approx(0.25 - np.pi)
    assert live.status().state == "ready"


@contextmanager
def bridge(network: Network, robot: str) -> Iterator[None]:
    command = [sys.executable, "-m", "services.gt_bridge", "--robot", robot]
    command += ["--set", 'truth="zenoh:vicon/people"']
    environment = os.environ | network.environment | {"OMP_NUM_THREADS": "1"}
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield
        finally:
            process.send_signal(signal.SIGTERM)
            _, errors = process.communicate(timeout=WAIT_S)
            assert process.returncode == 0, errors


def test_from_cdr_on_the_key_of_the_ros_bridge_to_truth_and_score(network: Network) -> None:
    robot = network.robot()
    bus = network.open(robot)
    watcher = Watcher(bus, Truth, Score, Health)
    with (
        bridge(network, robot),
        zenoh.open(read_config(None, "client", network.environment)) as session,
    ):
        watcher.wait(Health)
        vicon = session.declare_publisher("vicon/people")

        for stamp_ms in range(10_000, 10_500, 10):
            vicon.put(b"\x00\x01\x00\x00junk")
            vicon.put(cdr(stamp_ms * 10**6, 2.0))
        got = watcher.wait(Truth, lambda message: message.stamp_ns >= 10_490_000_000)
        bus.publish(tracks(10_405, track(4, 2.3, 0.4, vx=0.5, yaw_deg=0.0)))
        assert got.people[0].position_m.tolist() == [2.0, 0.0, 1.0]
        scored = watcher.wait(Score)
        assert scored.people[0].track == 4
        assert scored.people[0].position_error_m == pytest.approx([0.3, 0.4])
        assert scored.people[0].velocity_error_mps == pytest.approx([0.0, 0.0])
        assert scored.people[0].yaw_error_rad == pytest.approx(-0.25)
        assert scored.total.position_rmse_m == pytest.approx(0.5)
        health = watcher.wait_for_counters(bad_captured=50, received_captured=50)
        assert health.service == "gt_bridge"
