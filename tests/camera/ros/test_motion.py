"""Motion in a bag: pan-tilt cameras in /tf, and odometry from wheels."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import rotation_from_rpy, transform_from
from common.geometry.wheel_odometry import WheelConfig
from common.ros2.transforms import edges_of
from people4d.errors import DecodeError, SourceError
from people4d.messages import F64, MovingTransform, Odometry, StaticTransform
from services.camera.calibration import Intrinsics, camera_info
from services.camera.config import CameraConfig
from services.camera.node import CameraNode
from services.camera.ros.camera import RosbagOptions
from services.camera.ros.export import BagWriter, ExportItem
from services.camera.ros.motion import FrameTree, WheelReader
from services.camera.ros.source import RosbagSource
from services.camera.source import SourceFrame
from tests import builders
from tests.camera.memory import SIZE, capture, odometry
from tests.camera.ros.bags import FRAME, ODOMETRY, TF, Entry, Ros, frames

INFO = camera_info(Intrinsics(fx=10, fy=10, cx=4, cy=3), SIZE)
BAGS = [(1, "bag.bag"), (2, "bag_mcap")]
S = 10**9
NO_TURN = (0.0, 0.0, 0.0, 1.0)


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Worked transforms for turns about one axis."""
    halves = (math.sin(a / 2) for a in (roll, pitch, yaw))
    return (*halves, math.cos((roll + pitch + yaw) / 2))  # type: ignore[return-value]


def tf(ros: Ros, stamp_ns: int, *items: tuple[str, str, Sequence[float], Sequence[float]]) -> Any:
    """One message of several transforms."""
    stamped = [ros.transform(*item, stamp_ns).transforms[0] for item in items]
    return ros.make("tf2_msgs/msg/TFMessage", transforms=stamped)


def pan_tilt(ros: Ros, with_odometry: bool = True) -> list[Entry]:
    """A head that pans left by 0.2 rad in each tenth of a second and then tilts by as much.

    camera <-static- tilt <-/tf- pan <-/tf- neck <-static- base_link <-/odom- odom.
    """
    optical = (-0.5, 0.5, -0.5, 0.5)  # x right, y down, z forward
    still = tf(
        ros, 0, ("/tilt", FRAME, (0.1, 0, 0), optical), ("base_link", "neck", (0, 0, 1), NO_TURN)
    )
    entries: list[Entry] = [*frames(ros), (TF, S, still)]
    for k in range(4):
        stamp_ns = S + k * S // 10
        pan, tilt = quaternion(0, 0, 0.2 * k), quaternion(0, 0.1 * k, 0)
        moved = tf(
            ros,
            stamp_ns,
            ("neck", "pan", (0, 0, 0.1), pan),
            ("pan", "/tilt", (0, 0, 0), tilt),
            ("base_link", "left_arm", (0, 1, 0), pan),
            ("odom", "base_link", (0.5 * k, 0, 0), NO_TURN),
        )
        entries.append(("/tf", stamp_ns + 1000, moved))
        if with_odometry:
            message = ros.odometry(0.5 * k, 0.0, 0.0, stamp_ns)
            entries.append((ODOMETRY, stamp_ns, message))
    return sorted(entries, key=lambda entry: entry[1])


def pose_in(source: RosbagSource, target: str, stamp_ns: int) -> F64:
    """Return the pose of the camera by all transforms of the source."""
    known = TransformBuffer()
    for message in source.transforms:
        known.add_transform(message)
    for item in source:
        if isinstance(item, Odometry | MovingTransform):
            known.add_transform(item)
    found = known.lookup(target, FRAME, stamp_ns)
    assert found is not None
    return found.matrix


def expected(steps: float) -> F64:
    """The same, worked by hand: odom, base, neck, pan, tilt, camera."""
    base = transform_from((0.5 * steps, 0, 0), np.eye(3))
    neck = transform_from((0, 0, 1), np.eye(3))
    pan = transform_from((0, 0, 0.1), rotation_from_rpy(0, 0, 0.2 * steps))
    tilt = transform_from((0, 0, 0), rotation_from_rpy(0, 0.1 * steps, 0))
    optical = transform_from((0.1, 0, 0), np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0.0]]))
    return base @ neck @ pan @ tilt @ optical


@pytest.mark.slow
@pytest.mark.parametrize(("version", "name"), BAGS)
@pytest.mark.parametrize("with_odometry", [True, False])
def test_a_pan_tilt_camera_is_where_the_chain_says(
    tmp_path: Path, version: int, name: str, with_odometry: bool
) -> None:
    ros = Ros(version)
    path = ros.write(tmp_path / name, pan_tilt(ros, with_odometry))
    source = RosbagSource(path, RosbagOptions())
    assert [(t.parent, t.child) for t in source.transforms] == [
        ("tilt", FRAME),
        ("base_link", "neck"),
    ]
    for steps in (0, 1, 2.5):  # 2.5 is between two samples
        got = pose_in(source, "odom", S + round(steps * S / 10))
        np.testing.assert_allclose(got, expected(steps), atol=1e-6)
    moving = [(m.parent, m.child) for m in source if isinstance(m, MovingTransform)]
    head, base = {("neck", "pan"), ("pan", "tilt")}, {("odom", "base_link")}
    assert set(moving) == (head if with_odometry else head | base)  # odometry reports it once


def test_camera_with_a_tf_path_to_map_is_mounted_in_map(tmp_path: Path) -> None:
    # The origin of map lies 5 m behind the origin of odom, by localisation.
    ros = Ros(2)
    entries = pan_tilt(ros)
    for k in range(4):
        there = tf(ros, S + k * S // 10, ("world", "odom", (5, 0, 0), NO_TURN))
        entries.append(("/tf", 2 * S, there))
    source = RosbagSource(ros.write(tmp_path / "bag", entries), RosbagOptions(map_frame="world"))
    got = pose_in(source, "map", S + S // 10)
    np.testing.assert_allclose(got, transform_from((5, 0, 0), np.eye(3)) @ expected(1), atol=1e-6)


def test_a_camera_that_only_moves_gets_no_mount(tmp_path: Path) -> None:
    ros = Ros(2)
    swung = [
        ("/tf", S + k, tf(ros, S + k, ("map", FRAME, (0, 0, 1), quaternion(0, 0, 0.1 * k))))
        for k in range(3)
    ]
    source = RosbagSource(ros.write(tmp_path / "bag", [*frames(ros), *swung]), RosbagOptions())
    node = CameraNode(CameraConfig(), source)
    assert not [m for m in node.tick(0) if isinstance(m, StaticTransform)]
    node.close()
    assert sum(isinstance(item, MovingTransform) for item in source) == 3
    still = RosbagSource(tmp_path / "bag", RosbagOptions(tf_as_static=True))
    assert [(t.parent, t.child) for t in still.transforms] == [("map", FRAME)]
    assert not any(isinstance(item, MovingTransform) for item in still)


def test_our_own_bags_give_back_what_moves(tmp_path: Path) -> None:
    matrix = transform_from((1, 2, 3), rotation_from_rpy(0, 0.3, 0.5))
    moved = [builders.moving_transform(matrix, stamp_ns=k, sequence=k - S) for k in (S, S + 1)]
    fixed = builders.static_transform(np.eye(4), parent="head", child=INFO.frame_id)
    with BagWriter(tmp_path / "bag", INFO) as bag:
        bag.write_transforms([fixed], S)
        items: list[ExportItem] = [capture(1000), odometry(1000), *moved, capture(1001)]
        for item in items:
            bag.write(item)
    source = RosbagSource(tmp_path / "bag", RosbagOptions())
    assert [(t.parent, t.child) for t in source.transforms] == [("head", INFO.frame_id)]
    got = [item for item in source if isinstance(item, MovingTransform)]
    assert [(m.stamp_ns, m.sequence, m.parent, m.child) for m in got] == [
        (m.stamp_ns, m.sequence, m.parent, m.child) for m in moved
    ]
    np.testing.assert_allclose(got[0].matrix, matrix, atol=1e-12)
    assert sum(isinstance(item, Odometry) for item in source) == 1


def test_transforms_that_are_none_are_left_out() -> None:
    ros = Ros(2)
    nan = (math.nan, 0, 0)
    message = tf(ros, 7, ("a", "b", nan, NO_TURN), ("a", "c", (0, 0, 0), (0, 0, 0, 0)))
    assert list(edges_of(message)) == []
    (edge,) = edges_of(tf(ros, 7, ("/a", "b", (1, 2, 3), NO_TURN)))
    assert (edge.parent, edge.child, edge.stamp_ns) == ("a", "b", 7)
    assert edge.matrix[:3, 3].tolist() == [1, 2, 3]
    (nameless,) = edges_of(tf(ros, 7, ("", "b", (1, 2, 3), NO_TURN)))
    assert nameless.moving(7, 0).parent  # a valid part of a key
    far = dataclasses.replace(edge, matrix=2 * edge.matrix)
    with pytest.raises(DecodeError, match="transform: matrix"):
        far.moving(7, 0)


def test_lineage() -> None:
    tree = FrameTree()

    def ancestors(frame: str) -> list[str]:
        return [frame, *(parent for parent, _, _ in tree.path(frame))]

    for parent, child in (("map", "odom"), ("odom", "base"), ("base", "pan"), ("base", "arm")):
        tree.add_transform(parent, child)
    assert ancestors("pan") == ["pan", "base", "odom", "map"]
    assert ancestors("alone") == ["alone"]
    tree.add_transform("pan", "map")  # a loop ends
    assert ancestors("base") == ["base", "odom", "map", "pan"]


def joints(ros: Ros, stamp_ns: int, left: float, right: float) -> Any:
    return ros.make(
        "sensor_msgs/msg/JointState",
        header=ros.header(stamp_ns, ""),
        name=["wheel_right_joint", "arm", "wheel_left_joint"],
        position=np.array([right, 9.0, left]),
    )


@pytest.mark.parametrize(("version", "name"), BAGS)
def test_wheels_that_are_joints(tmp_path: Path, version: int, name: str) -> None:
    # Wheels of 0.05 m turn by 2 rad: 0.1 m ahead. Then the right one by 2 rad: 0.1 m over
    # the track of 0.2 m is 0.5 rad to the left.
    ros = Ros(version)
    positions = [(0.0, 0.0), (2.0, 2.0), (2.0, 4.0)]
    entries = [
        ("/joint_states", S + k, joints(ros, S + k * S // 10, *sides))
        for k, sides in enumerate(positions)
    ]
    path = ros.write(tmp_path / name, [*frames(ros), *entries])
    wheels = WheelConfig(radius_m=0.05, track_m=0.2)
    options = RosbagOptions(wheel_topics=("/joint_states",), wheels=wheels)
    got = [item for item in RosbagSource(path, options) if isinstance(item, Odometry)]
    assert [(o.stamp_ns, o.sequence) for o in got] == [(S + k * S // 10, k) for k in range(3)]
    assert [o.theta_rad for o in got] == pytest.approx([0, 0, 0.5])
    assert got[1].x_m == pytest.approx(0.1)


def test_wheels_that_are_ticks(tmp_path: Path) -> None:
    # 100 ticks a turn and a radius of 1 / 2 pi: 0.01 m a tick. An encoder of 16 bits wraps from
    # 32767 to -32768: the right wheel made 20 ticks, 0.2 m over the track of 0.4 m.
    ros = Ros(2)

    def ticks(value: int) -> Any:
        return ros.make("std_msgs/msg/Int16", data=value)

    entries: list[Entry] = []
    for k, (left, right) in enumerate(((5, 32760), (5, 32780 - 65536))):
        entries.append(("/lwheel", S + k * S // 10, ticks(left)))
        entries.append(("/rwheel", S + k * S // 10 + 1, ticks(right)))
    path = ros.write(tmp_path / "bag", [*frames(ros), *entries])
    wheels = WheelConfig(radius_m=0.5 / math.pi, track_m=0.4, ticks_per_turn=100, wraps_at=65536)
    options = RosbagOptions(wheel_topics=("/lwheel", "/rwheel"), wheels=wheels)
    got = [item for item in RosbagSource(path, options) if isinstance(item, Odometry)]
    assert [o.stamp_ns for o in got] == [S + 1, S + S // 10 + 1]
    assert [o.theta_rad for o in got] == pytest.approx([0, 0.5])
    assert sum(isinstance(item, SourceFrame) for item in RosbagSource(path, options)) == 3
    for wrong in (("/lwheel",), ("/lwheel", "/none"), ("/camera/color/camera_info",)):
        with pytest.raises(SourceError, match="wheel_topics: expected a topic of sensor_msgs"):
            RosbagSource(path, RosbagOptions(wheel_topics=wrong))


def test_wheels_that_cannot_be_used() -> None:
    ros, wheels = Ros(2), WheelReader(WheelConfig(joints=("wheel_left_joint", "other")))
    with pytest.raises(DecodeError, match="joints: expected positions of wheel_left_joint, other"):
        wheels.joints(joints(ros, 0, 1.0, 2.0), 0)
    wheels = WheelReader(WheelConfig())
    for bad in (math.nan, math.inf, 1e300):
        with pytest.raises(DecodeError, match="finite positions"):
            wheels.joints(joints(ros, 0, 1.0, bad), 0)
    assert WheelConfig().ticks_per_turn == math.tau
