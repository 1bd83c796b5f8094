"""Frames on a base that drives, worked by hand."""

import math

import numpy as np
import pytest

from common.geometry.transform_buffer import MOVING_MAX, TransformBuffer, transform_from_odometry
from common.geometry.transforms import LINK_FROM_OPTICAL, apply, rotation_from_rpy, transform_from
from people4d.messages import F64, MovingTransform, Odometry, StaticTransform
from people4d.topics import TRANSFORMS_MAX
from tests import builders

CAMERA = "front_optical_frame"


def fixed(parent: str, child: str, matrix: F64) -> StaticTransform:
    return builders.static_transform(matrix, parent=parent, child=child)


def shift(x: float, y: float = 0.0, z: float = 0.0) -> F64:
    return transform_from([x, y, z], np.eye(3))


def odometry(at_ms: int, x_m: float, theta_deg: float = 0.0) -> Odometry:
    return builders.odometry(
        stamp_ns=at_ms * 1_000_000, sequence=at_ms, x_m=x_m, theta_rad=math.radians(theta_deg)
    )


def frames(*messages: StaticTransform | MovingTransform | Odometry) -> TransformBuffer:
    made = TransformBuffer()
    for message in messages:
        made.add_transform(message)
    return made


MOUNT = fixed("base_link", CAMERA, shift(0.2, 0.0, 1.0) @ LINK_FROM_OPTICAL)


def test_standing_person_keeps_its_map_position_while_the_robot_turns() -> None:
    # Map's origin is 1 m behind odom's. The camera is 0.2 m before the base, 1 m high. A person
    # 3 m before the base at the start: optical (0, 0, 2.8), in map (4, 0, 1). Half-way through a
    # turn of 60 degrees to the left the person is seen 30 degrees to the right of the base.
    made = frames(MOUNT, fixed("map", "odom", shift(1)), odometry(0, 0), odometry(100, 0, 60))
    for at_ms, turned_deg in ((0, 0), (50, 30), (100, 60)):
        angle = math.radians(turned_deg)
        forward, right = 3 * math.cos(angle), 3 * math.sin(angle)
        estimate = made.lookup("map", CAMERA, at_ms * 1_000_000)
        assert estimate is not None
        assert not estimate.is_uncertain
        measured = [right, 0.0, forward - 0.2]
        assert apply(estimate.matrix, measured) == pytest.approx(np.array([4.0, 0.0, 1.0]))


def test_transform_is_usable_in_both_directions() -> None:
    made = frames(odometry(0, 2.0))
    estimate = made.lookup("base_link", "odom", 0)
    assert estimate is not None
    np.testing.assert_allclose(estimate.matrix, shift(-2))


def test_static_transform_is_found_at_any_time() -> None:
    made = frames(MOUNT, odometry(1000, 5.0))
    estimate = made.lookup("base_link", CAMERA, 0)
    assert estimate is not None
    np.testing.assert_array_equal(estimate.matrix, MOUNT.matrix)
    assert made.lookup("odom", CAMERA, 0) is None  # before the first sample
    assert made.lookup("map", CAMERA, 0) is None  # odom is not linked to map


def test_awaits_sample_only_if_the_path_moves() -> None:
    made = frames(MOUNT, odometry(100, 0))
    assert made.awaits_sample("odom", CAMERA, 101_000_000)
    assert not made.awaits_sample("odom", CAMERA, 100_000_000)
    assert not made.awaits_sample("base_link", CAMERA, 101_000_000)
    assert not made.awaits_sample("map", CAMERA, 101_000_000)


def head(at_ms: int, matrix: F64) -> MovingTransform:
    return builders.moving_transform(matrix, stamp_ns=at_ms * 1_000_000)


def turned(yaw_deg: float, pitch_deg: float) -> F64:
    angles = math.radians(pitch_deg), math.radians(yaw_deg)
    return transform_from([0.0, 0.0, 1.0], rotation_from_rpy(0.0, *angles))


def test_camera_on_a_pan_tilt_head_on_a_driving_base() -> None:
    # Half-way between two times the base is at x = 0.2, the head 1 m above it has panned 45 degrees
    # to the left: what is 2 m before the camera is at 0.2 + sqrt 2, sqrt 2 and 1 m high.
    made = frames(
        fixed("head", CAMERA, LINK_FROM_OPTICAL),
        odometry(0, 0.0),
        odometry(200, 0.4),
        head(0, turned(0, 0)),
        head(200, turned(90, 0)),
    )
    estimate = made.lookup("odom", CAMERA, 100_000_000)
    assert estimate is not None
    point = apply(estimate.matrix, [0.0, 0.0, 2.0])
    assert point == pytest.approx(np.array([0.2 + math.sqrt(2), math.sqrt(2), 1.0]))
    # A head tilted down by 30 degrees: a point 2 m ahead of it is 1 m below it.
    made.add_transform(head(300, turned(90, 30)))
    made.add_transform(odometry(300, 0.4))
    estimate = made.lookup("odom", CAMERA, 300_000_000)
    assert estimate is not None
    point = apply(estimate.matrix, [0.0, 0.0, 2.0])
    assert point == pytest.approx(np.array([0.4, math.sqrt(3), 0.0]))


def test_uncertainties_of_two_extrapolated_transforms_add_up() -> None:
    # A head that turns on a base that drives, 0.2 s after both last samples: 0.5 * 0.04 m.
    made = frames(odometry(0, 0), odometry(50, 0), head(0, turned(0, 0)), head(50, turned(0, 0)))
    estimate = made.lookup("odom", "head", 250_000_000)
    assert estimate is not None
    assert estimate.sigma_m == pytest.approx(0.02 * math.sqrt(2))


def test_pose_of_odometry_is_planar() -> None:
    matrix = transform_from_odometry(odometry(0, 1.5, 90))
    assert apply(matrix, [1.0, 0.0, 0.5]) == pytest.approx(np.array([1.5, 1.0, 0.5]))


def test_lookup_static_refuses_moving_transforms() -> None:
    made = frames(MOUNT, odometry(0, 1.0))
    mount = made.lookup_static("base_link", CAMERA)
    assert mount is not None
    np.testing.assert_array_equal(mount, MOUNT.matrix)
    assert made.lookup_static("odom", CAMERA) is None
    assert made.lookup_static("map", CAMERA) is None


def test_invented_frames_are_refused_and_known_ones_go_on() -> None:
    made = frames(MOUNT, odometry(0, 0.0))
    for number in range(2000):
        made.add_transform(fixed(f"a{number}_optical_frame", f"b{number}", np.eye(4)))
        made.add_transform(builders.moving_transform(np.eye(4), parent="odom", child=f"c{number}"))
        assert made.fixed_frame("base_link") == "odom"
    made.add_transform(odometry(100, 0.4))
    found = made.lookup("odom", CAMERA, 100_000_000)
    assert found is not None
    np.testing.assert_allclose(found.matrix[:3, 3], [0.6, 0.0, 1.0])
    assert made.counters["refused_transforms"] >= 2 * 2000 - TRANSFORMS_MAX
    assert len(made._histories) == MOVING_MAX
