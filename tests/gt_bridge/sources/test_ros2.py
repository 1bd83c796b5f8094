"""Live truth from topics of ROS 2."""

import struct
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("zenoh_ros2_sdk")

from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.names import TopicType
from people4d.errors import ConfigError
from people4d.messages import Message, Truth
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.node import GtBridgeNode
from services.gt_bridge.sources.registry import open_truth
from services.gt_bridge.sources.ros2 import PEOPLE, POSE
from tests.common.ros2.foreign import raw_session
from tests.network import WAIT_S, Network

pytestmark = pytest.mark.network

TOPICS = ("/vrpn/anna/pose", "/vrpn/bo/pose")
YAW = {"orientation": {"z": np.sin(0.25), "w": np.cos(0.25)}}


@pytest.fixture
def session(network: Network) -> Iterator[Any]:
    with raw_session(network.endpoint) as session:
        yield session


def put(session: Any, topic: str, kind: str, fields: Any, cdr: bytes = b"") -> None:
    key = TopicType(topic, kind, types.type_hash(kind)).key(0)
    attachment = struct.pack("<qqB16s", 1, 1, 16, b"x" * 16)
    session.put(key, cdr or types.encode(kind, fields), attachment=attachment)


def head(number: int, frame: str = "map") -> Any:
    return {"stamp": {"sec": 100 + number, "nanosec": 0}, "frame_id": frame}


def node_of(truth: str, network: Network) -> GtBridgeNode:
    config = GtBridgeConfig(truth=truth, ros2=Ros2Config(endpoints=(network.endpoint,)))
    return GtBridgeNode(open_truth(config), config)


def collect(node: GtBridgeNode, send: Any, count: int, counter: str = "") -> list[Truth]:
    """Send with rising numbers until the messages are out and an event is counted."""
    found: list[Message] = []
    waiting, end = threading.Event(), time.monotonic() + WAIT_S
    number = 0
    while len(found) < count or (counter and not node.status().counters[counter]):
        assert time.monotonic() < end, node.status()
        send(number)
        number += 1
        waiting.wait(0.03)
        found += node.tick(time.monotonic_ns())
    return [message for message in found if isinstance(message, Truth)]


def test_people_are_published_as_truth(network: Network, session: Any) -> None:
    node = node_of("ros2:/vicon/people", network)
    person = {"name": "anna", "position": {"x": 1.0, "y": 2.0}, "velocity": {"x": 0.5}}

    def send(number: int) -> None:
        put(session, "/vicon/people", PEOPLE, {"header": head(number), "people": [person]})
        put(session, "/vicon/people", PEOPLE, {}, cdr=b"\0\1\0\0junk")
        put(session, "/vicon/people", PEOPLE, {"people": [person]})  # without a stamp

    truth = collect(node, send, 2, "bad_message")[-1]
    node.close()
    (anna,) = truth.people
    assert (anna.id, truth.frame_id, truth.stamp_ns % 10**9) == ("anna", "map", 0)
    np.testing.assert_array_equal(anna.position_m, [1.0, 2.0, 0.0])
    assert anna.velocity_mps is not None
    assert anna.velocity_mps[0] == 0.5


def test_poses_of_one_capture_become_one_message(network: Network, session: Any) -> None:
    node = node_of(f"ros2:{','.join(TOPICS)}", network)
    assert node.status().reason == "no messages on /vrpn/anna/pose, /vrpn/bo/pose"

    def send(number: int) -> None:
        for x, topic in enumerate(TOPICS):
            pose = {"position": {"x": float(x)}, **YAW}
            put(session, topic, POSE, {"header": head(number), "pose": pose})

    truth = collect(node, send, 3)[-1]
    node.close()
    assert [person.id for person in truth.people] == ["anna", "bo"]
    assert [person.position_m[0] for person in truth.people] == [0.0, 1.0]
    assert [person.yaw_rad for person in truth.people] == pytest.approx([0.5, 0.5])


def test_pose_of_one_person_does_not_wait_for_the_others(network: Network, session: Any) -> None:
    node = node_of(f"ros2:{','.join(TOPICS)}", network)

    def send(number: int) -> None:
        put(session, TOPICS[0], POSE, {"header": head(number // 8), "pose": YAW})

    (first, *_) = collect(node, send, 1)
    node.close()
    assert [person.id for person in first.people] == ["anna"]


def test_thirty_absent_topics_are_counted_and_reported_and_one_that_comes_is_read(
    network: Network, session: Any
) -> None:
    topics = [f"/vrpn/person{number}/pose" for number in range(30)]
    node = node_of(f"ros2:{','.join(topics)}", network)
    try:
        status = node.status()
        assert status.state == "degraded"
        assert status.counters["absent_topics"] == 30
        assert status.reason == f"no messages on {', '.join(topics[:4])} and 26 more"

        def send(number: int) -> None:
            put(session, topics[7], POSE, {"header": head(number), "pose": YAW})

        (truth, *_) = collect(node, send, 1)
        assert [person.id for person in truth.people] == ["person7"]
        assert node.status().counters["absent_topics"] == 29
        assert node.status().state == "degraded"
    finally:
        node.close()


@pytest.mark.parametrize("truth", ["ros2:", "ros2:people", "ros2+tcp:/people", "ros2:/a,b"])
def test_wrong_truth_is_refused(truth: str) -> None:
    with pytest.raises(ConfigError, match="names no topics"):
        open_truth(GtBridgeConfig(truth=truth))
