"""The chosen person in ROS 2: pose, person, marker and commands."""

import numpy as np
import pytest

from common.ros2 import types
from people4d.messages import Target, TargetCommand
from people4d.messages.target import TargetState
from services.ros2_bridge.config import Ros2BridgeConfig
from services.ros2_bridge.node import Ros2BridgeNode
from tests.ros2_bridge.memory import MemoryTransport

START_NS = 1_700_000_000 * 10**9
TOPIC = "/people4d/target"


def bridge() -> tuple[Ros2BridgeNode, MemoryTransport]:
    config = Ros2BridgeConfig(publish=("target",))
    transport = MemoryTransport(config.ros2)
    return Ros2BridgeNode(config, transport, lambda: START_NS), transport


def target(state: TargetState = "locked") -> Target:
    is_known = state in ("locked", "occluded")
    return Target(
        stamp_ns=START_NS,
        sequence=0,
        state=state,
        frame_id="map",
        camera="front",
        id=7 if is_known else None,
        position_m=np.array([2.0, -1.0, 1.2]) if is_known else None,
        velocity_mps=np.array([0.0, 0.5, 0.0]) if is_known else None,
        probability=0.97,
    )


def test_locked_person_is_published_as_pose_person_and_marker() -> None:
    node, ros = bridge()
    node.handle(target(), 0)
    pose = ros.last(TOPIC)
    assert (pose.header.frame_id, pose.header.stamp.sec) == ("map", 1_700_000_000)
    assert (pose.pose.position.x, pose.pose.position.y) == (2.0, -1.0)
    # The person walks along y: half a right angle in the quaternion.
    assert pose.pose.orientation.z == pytest.approx(np.sin(np.pi / 4))
    person = ros.last(f"{TOPIC}/person")
    assert (person.name, person.velocity.y) == ("person_7", 0.5)
    assert person.reliability == pytest.approx(0.97)
    assert dict(zip(person.tagnames, person.tags, strict=True)) == {"id": "7", "state": "locked"}
    assert ros.last(f"{TOPIC}/marker").ns == "target"


@pytest.mark.parametrize("state", ["searching", "lost", "none"])
def test_person_who_is_not_located_is_not_published(state: TargetState) -> None:
    node, ros = bridge()
    node.handle(target(state), 0)
    assert ros.messages(TOPIC) == ros.messages(f"{TOPIC}/person") == []


@pytest.mark.parametrize(
    ("text", "action", "id_"),
    [
        ("3", "id", 3),
        (" nearest ", "nearest", None),
        ("raised_hand", "raised_hand", None),
        ("none", "none", None),
    ],
)
def test_text_chooses(text: str, action: str, id_: int | None) -> None:
    node, ros = bridge()
    ros.send(f"{TOPIC}/follow", types.encode("std_msgs/msg/String", {"data": text}))
    (command,) = node.tick(0)
    assert isinstance(command, TargetCommand)
    assert (command.action, command.id, command.chooser) == (action, id_, "ROS 2")
    assert list(node.tick(0)) == []


def test_two_numbers_choose_a_position() -> None:
    node, ros = bridge()
    ros.send(f"{TOPIC}/follow", types.encode("std_msgs/msg/String", {"data": "1.5 -2"}))
    (command,) = node.tick(0)
    assert isinstance(command, TargetCommand)
    assert command.position_m is not None
    np.testing.assert_allclose(command.position_m, [1.5, -2.0])


@pytest.mark.parametrize("text", ["", "0", "-3", "left", "nan 1", "1 2 3", "1e9 0"])
def test_other_text_is_counted_and_chooses_no_person(text: str) -> None:
    node, ros = bridge()
    ros.send(f"{TOPIC}/follow", types.encode("std_msgs/msg/String", {"data": text}))
    assert list(node.tick(0)) == []
    assert node.status().counters["bad_command"] == 1
