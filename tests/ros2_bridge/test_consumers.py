"""Messages of people read by planners: accepted, with the right numbers.

A robot drives while people come, leave, hide and turn. Its transforms arrive 40 ms after their
stamps, as from SLAM, and people 60 ms after the image.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from common.geometry.transforms import invert, rotation_from_rpy, transform_from, wrap
from common.ros2 import types
from common.ros2.messages.basic import TF, transforms
from people4d.messages import F64, Track, Tracks
from services.ros2_bridge.config import Ros2BridgeConfig
from services.ros2_bridge.node import Ros2BridgeNode
from tests import builders
from tests.ros2_bridge.memory import MemoryTransport
from tests.ros2_bridge.readers import (
    RefusalError,
    Tf2Buffer,
    read_cohan,
    read_social_costmap,
    read_social_force,
    stamp_ns,
    stoi,
)

MS = 1_000_000
START_NS = 1_700_000_000 * 10**9
STEPS = 1200  # of 10 ms
TF_DELAY, PEOPLE_DELAY = 4, 6  # steps


@dataclass
class Read:
    """A message when its reader takes it."""

    message: Any
    tf: Tf2Buffer
    now_ns: int
    odometry_ns: int


def map_from_odom(time_ns: int) -> F64:
    """Return a drift that SLAM corrects."""
    t = (time_ns - START_NS) / 1e9
    return transform_from((0.02 * t, -0.01 * t, 0.0), rotation_from_rpy(0.0, 0.0, 0.004 * t))


def person(number: int, t: float) -> Track:
    """Return one person that walks in a circle and is hidden now and then."""
    turn = 0.3 * t + number
    hidden = number % 3 == 0 and t % 2 < 0.5
    still = number % 4 == 1
    return builders.track(
        id=number,
        state="lost" if hidden else "confirmed",
        detection=None if hidden else 0,
        position_m=np.array([3 * math.cos(turn), 3 * math.sin(turn), 1.2])
        if not still
        else np.array([5.0, float(number), 1.2]),
        velocity_mps=np.zeros(3)
        if still
        else 0.9 * np.array([-math.sin(turn), math.cos(turn), 0.0]),
        yaw_rad=None if number == 2 else wrap(turn + math.pi / 2),
        covariance=0.01 * np.eye(6),
    )


def tracks(step: int) -> Tracks:
    t = step * 0.01
    present = [k for k in range(1, 9) if (t + 1.3 * k) % 11 > 0.4 * k]
    people = [person(k, t) for k in present]
    return builders.tracks(*people, stamp_ns=START_NS + step * 10 * MS, sequence=step)


def drive(config: Ros2BridgeConfig, topic: str, delay: int = PEOPLE_DELAY) -> Iterator[Read]:
    """Yield the messages that a reader takes from a topic while the robot drives."""
    clock_ns = START_NS
    transport = MemoryTransport(config.ros2)
    node = Ros2BridgeNode(config, transport, lambda: clock_ns)
    tf, done, odometry_ns = Tf2Buffer(), 0, 0
    for step in range(STEPS):
        clock_ns = START_NS + step * 10 * MS
        made_ns = clock_ns - TF_DELAY * 10 * MS
        if step % 2 == 0:  # 50 Hz
            matrix, odometry_ns = map_from_odom(made_ns), made_ns
            tf.set_transform("map", "odom", made_ns, matrix)
            if config.reader_frame:
                edges = transforms([("map", "odom", matrix)], made_ns)
                transport.send("/tf", types.encode(TF, edges))
        if step % 5 == 0 and step >= delay:  # 20 Hz
            node.handle(tracks(step - delay), clock_ns)
        node.tick(clock_ns)
        sent = transport.topics[topic].payloads
        for payload in itertools.islice(sent, done, None):
            yield Read(
                types.decode(transport.topics[topic].kind, payload), tf, clock_ns, odometry_ns
            )
        done = len(sent)
    assert done > STEPS / 5 - 10


def refusals(reads: Iterator[Read], read: Any) -> tuple[int, int]:
    """Return the numbers of refused messages and of all messages."""
    count, total = 0, 0
    for one in reads:
        total += 1
        try:
            read(one)
        except RefusalError:
            count += 1
    return count, total


def costmap(one: Read) -> None:
    time_ns = stamp_ns(one.message)
    read = read_social_costmap(one.message, one.tf, "odom")
    truth = {str(t.id): t for t in tracks(round((time_ns - START_NS) / (10 * MS))).tracks}
    for published, (x, y, vx, vy) in zip(one.message.people, read, strict=True):
        track = truth[published.name]
        odom_from_map = invert(map_from_odom(time_ns))
        position = odom_from_map @ [*track.position_m, 1.0]
        velocity = odom_from_map[:3, :3] @ track.velocity_mps
        np.testing.assert_allclose((x, y), position[:2], atol=1e-3)
        np.testing.assert_allclose((vx, vy), velocity[:2], atol=1e-6)


def force(one: Read) -> None:
    agents = read_social_force(one.message, one.tf, "odom", one.odometry_ns)
    for published, agent in zip(one.message.people, agents, strict=True):
        assert agent["id"] == int(published.name)
        assert agent["group"] == -1
        still = agent["id"] % 4 == 1
        assert agent["speed"] == pytest.approx(0.0 if still else 0.9)
        if agent["id"] not in (1, 5):
            direction = math.atan2(published.velocity.y, published.velocity.x)
            assert math.cos(published.position.z - direction) > 0.999
        assert abs(agent["omega"]) < 0.35


def cohan(one: Read) -> None:
    read_cohan(one.message, one.tf, "odom", one.now_ns)


def test_social_costmap_refuses_nothing() -> None:
    config = Ros2BridgeConfig(publish=("people",), reader_frame="odom")
    assert refusals(drive(config, "/people"), costmap)[0] == 0


def test_social_costmap_finds_transforms_that_are_late() -> None:
    """Without waiting for transforms, a lookup at the stamp of people fails."""
    unaware = Ros2BridgeConfig(publish=("people",))
    refused, total = refusals(drive(unaware, "/people", delay=2), costmap)
    assert refused > total / 2
    aware = Ros2BridgeConfig(publish=("people",), reader_frame="odom")
    assert refusals(drive(aware, "/people", delay=2), costmap)[0] == 0


def test_social_force_planner_refuses_nothing() -> None:
    config = Ros2BridgeConfig(publish=("people",), convention="sfm")
    assert refusals(drive(config, "/people"), force)[0] == 0


def test_cohan_refuses_nothing() -> None:
    config = Ros2BridgeConfig(publish=("agents",), reader_frame="odom")
    assert refusals(drive(config, "/tracked_agents"), cohan)[0] == 0


def test_cohan_refuses_a_recording_unless_stamps_are_those_of_sending() -> None:
    """With its own stamps, a recording played 0.3 s late is too old for CoHAN."""
    acquired = Ros2BridgeConfig(publish=("agents",), reader_frame="odom")
    refused, total = refusals(drive(acquired, "/tracked_agents", delay=30), cohan)
    assert refused == total
    sent = Ros2BridgeConfig(publish=("agents",), reader_frame="odom", stamps="sent")
    assert refusals(drive(sent, "/tracked_agents", delay=30), cohan)[0] == 0


@pytest.mark.parametrize(
    ("text", "number"),
    [("7", 7), (" -1", -1), ("+3x", 3), ("lost", None), ("", None), ("9" * 10, None)],
)
def test_stoi_is_that_of_cpp(text: str, number: int | None) -> None:
    if number is None:
        with pytest.raises(RefusalError):
            stoi(text)
    else:
        assert stoi(text) == number
