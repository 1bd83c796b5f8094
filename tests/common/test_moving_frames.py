"""Frames on a base that drives, worked by hand."""

import math

import numpy as np
import pytest

from common.geometry import LINK_FROM_OPTICAL, apply, transform_from
from common.messages import F64, Odometry, StaticTransform
from common.moving_frames import MovingFrames, matrix_of
from common.trail import TrailConfig

CAMERA = "front_optical_frame"


def fixed(parent: str, child: str, matrix: F64) -> StaticTransform:
    return StaticTransform(stamp_ns=0, sequence=0, parent=parent, child=child, matrix=matrix)


def shift(x: float, y: float = 0.0, z: float = 0.0) -> F64:
    return transform_from([x, y, z], np.eye(3))


def odometry(at_ms: int, x_m: float, theta_deg: float = 0.0, child: str = "base_link") -> Odometry:
    return Odometry(
        stamp_ns=at_ms * 1_000_000,
        sequence=at_ms,
        frame_id="odom",
        child_frame_id=child,
        x_m=x_m,
        y_m=0.0,
        theta_rad=math.radians(theta_deg),
    )


def frames(*messages: StaticTransform | Odometry) -> MovingFrames:
    made = MovingFrames(TrailConfig())
    for message in messages:
        made.add(message)
    return made


MOUNT = fixed("base_link", CAMERA, shift(0.2, 0.0, 1.0) @ LINK_FROM_OPTICAL)


def test_someone_who_stands_still_stays_in_place_while_the_robot_turns() -> None:
    # Map's origin is 1 m behind odom's. The camera is 0.2 m before the base, 1 m high. A person
    # 3 m before the base at the start: optical (0, 0, 2.8), in map (4, 0, 1). Half-way through a
    # turn of 60 degrees to the left the person is seen 30 degrees to the right of the base.
    made = frames(MOUNT, fixed("map", "odom", shift(1)), odometry(0, 0), odometry(100, 0, 60))
    for at_ms, turned_deg in ((0, 0), (50, 30), (100, 60)):
        angle = math.radians(turned_deg)
        forward, right = 3 * math.cos(angle), 3 * math.sin(angle)
        placement = made.find("map", CAMERA, at_ms * 1_000_000)
        assert placement is not None
        assert not placement.is_guess
        seen = [right, 0.0, forward - 0.2]
        assert apply(placement.matrix, seen) == pytest.approx(np.array([4.0, 0.0, 1.0]))


def test_both_directions_are_known() -> None:
    made = frames(odometry(0, 2.0))
    placement = made.find("base_link", "odom", 0)
    assert placement is not None
    np.testing.assert_allclose(placement.matrix, shift(-2))


def test_what_does_not_move_needs_no_time() -> None:
    made = frames(MOUNT, odometry(1000, 5.0))
    placement = made.find("base_link", CAMERA, 0)
    assert placement is not None
    np.testing.assert_array_equal(placement.matrix, MOUNT.matrix)
    assert made.find("odom", CAMERA, 0) is None  # before the first sample
    assert made.find("map", CAMERA, 0) is None  # nobody tells where odom lies


def test_a_frame_waits_for_the_odometry_of_its_time_only_where_it_counts() -> None:
    made = frames(MOUNT, odometry(100, 0))
    assert made.waits("odom", CAMERA, 101_000_000)
    assert not made.waits("odom", CAMERA, 100_000_000)
    assert not made.waits("base_link", CAMERA, 101_000_000)
    assert not made.waits("map", CAMERA, 101_000_000)


def test_guesses_of_two_motions_add_up() -> None:
    # A head that turns on a base that drives; 0.2 s after both were told. Each 0.5 * 1 * 0.04 m.
    made = frames(odometry(0, 0), odometry(50, 0))
    for at_ms in (0, 50):
        head = odometry(at_ms, 0, child="head")
        made.add(
            Odometry(
                stamp_ns=head.stamp_ns,
                sequence=0,
                frame_id="base_link",
                child_frame_id="head",
                x_m=0.0,
                y_m=0.0,
                theta_rad=0.0,
            )
        )
    placement = made.find("odom", "head", 250_000_000)
    assert placement is not None
    assert placement.sigma_m == pytest.approx(0.02 * math.sqrt(2))


def test_the_pose_of_a_base_is_on_the_plane() -> None:
    matrix = matrix_of(odometry(0, 1.5, 90))
    assert apply(matrix, [1.0, 0.0, 0.5]) == pytest.approx(np.array([1.5, 1.0, 0.5]))


def test_what_stands_is_told_from_what_moves() -> None:
    made = frames(MOUNT, odometry(0, 1.0))
    standing = made.standing("base_link", CAMERA)
    assert standing is not None
    np.testing.assert_array_equal(standing, MOUNT.matrix)
    assert made.standing("odom", CAMERA) is None
    assert made.standing("map", CAMERA) is None
