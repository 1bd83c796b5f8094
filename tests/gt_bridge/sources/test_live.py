"""Live truth at the node: stamps, frames, and people_msgs/People from CDR."""

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from common.ros2 import types
from people4d.errors import DecodeError
from people4d.messages import Message, Truth
from services.gt_bridge.config import FixedTransform, GtBridgeConfig
from services.gt_bridge.node import GtBridgeNode
from services.gt_bridge.sources.ros import stamped_truth
from services.gt_bridge.sources.ros2 import PEOPLE
from tests.gt_bridge.scene import POSE, truth

PERSON = {
    "name": "anna",
    "position": {"x": 5.0, "z": 1.0},
    "velocity": {"x": 0.5},
    "tagnames": ["yaw_rad"],
    "tags": ["0.25"],
}


class Capture:
    """Live source with messages captured by a test."""

    problem = ""

    def __init__(self) -> None:
        self.counters = Counter[str]()
        self.captured: list[Truth] = []
        self.closed = False

    def __iter__(self) -> Iterator[Truth]:
        return iter(())

    def start(self, wake: Callable[[], None]) -> None:
        self.wake = wake

    def take_truth(self) -> list[Truth]:
        captured, self.captured = self.captured, []
        return captured

    def wake_s(self) -> float | None:
        return None

    def close(self) -> None:
        self.closed = True


class Live:
    """Node that scores against live truth."""

    def __init__(self, **settings: Any) -> None:
        self.source = Capture()
        self.node = GtBridgeNode(self.source, GtBridgeConfig(**settings))

    def capture(self, *messages: Truth) -> list[Message]:
        self.source.captured += messages
        return list(self.node.tick(0))


def people(stamp_ns: int) -> Truth:
    """Return truth decoded from CDR."""
    header = {"stamp": {"nanosec": stamp_ns}, "frame_id": "map"}
    cdr = types.encode(PEOPLE, {"header": header, "people": [PERSON]})
    return stamped_truth(types.decode(PEOPLE, cdr))


def test_people_by_hand() -> None:
    # Encapsulation 0001 (little-endian), stamp 5 s + 7 ns, frame "map", no people.
    payload = bytes.fromhex("00010000 05000000 07000000 04000000 6d617000 00000000")
    got = stamped_truth(types.decode(PEOPLE, payload))
    assert (got.stamp_ns, got.frame_id, got.people) == (5_000_000_007, "map", ())
    (person,) = people(5).people
    assert (person.id, person.yaw_rad) == ("anna", 0.25)
    assert person.position_m.tolist() == [5.0, 0.0, 1.0]


def test_message_without_a_stamp_is_refused() -> None:
    with pytest.raises(DecodeError, match=r"header\.stamp, got 0"):
        people(0)


def test_live_truth_goes_out_at_once_with_its_offset() -> None:
    live = Live(offset_s=0.5)
    assert live.node.status().state == "ready"
    assert live.node.wake_ns() == 0  # to start the source
    (got,) = live.capture(truth(100))
    assert got.stamp_ns == 600_000_000
    assert live.node.wake_ns() is None
    live.node.close()
    assert live.source.closed


def test_live_truth_that_comes_late_is_counted() -> None:
    live = Live()
    assert len(live.capture(truth(5000))) == 1
    assert live.capture(truth(4990), truth(5000)) == []
    assert live.node.status().counters["late_truth"] == 2
    assert len(live.capture(truth(1000))) == 1  # much earlier stamps: the capture restarted


def test_the_chain_from_mocap_over_the_camera_to_the_map() -> None:
    # Motion capture measured the camera's body 2 m along its own x, turned by 180 degrees about z.
    # In the map the camera is at the origin, so mocap's x = 5 is at x = 2 - 5 = -3.
    calibrated = FixedTransform(
        parent="vicon", child="front_link", xyz_m=(2.0, 0.0, 0.0), rpy_rad=(0.0, 0.0, np.pi)
    )
    live = Live(transforms=(calibrated,), truth_frame="vicon")
    (raw,) = live.capture(people(5))
    assert isinstance(raw, Truth)
    assert raw.frame_id == "vicon"  # the pose of the camera is unknown
    assert live.node.status().state == "degraded"
    assert "no transform map <- vicon" in live.node.status().reason
    assert live.node.status().counters["unlinked"] == 1

    live.node.handle(POSE, 0)
    (got,) = live.capture(people(6))
    assert isinstance(got, Truth)
    assert got.frame_id == "map"
    (person,) = got.people
    assert person.position_m == pytest.approx([-3.0, 0.0, 2.0])  # the camera is 1 m up
    assert person.velocity_mps == pytest.approx([-0.5, 0.0, 0.0])
    assert person.yaw_rad == pytest.approx(0.25 - np.pi)
    assert live.node.status().state == "ready"
