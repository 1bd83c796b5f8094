"""Poses of cameras, fixed or on a base that moves."""

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, transform_from
from people4d.messages import F64, Odometry, StaticTransform
from services.tracker.cameras.poses import CameraPoseLookup
from tests import builders

CAMERA = "front_optical_frame"
MS = 1_000_000


def fixed(parent: str, child: str, x_m: float) -> StaticTransform:
    matrix = transform_from([x_m, 0.0, 1.0], LINK_FROM_OPTICAL[:3, :3])
    return builders.static_transform(matrix, parent=parent, child=child)


def odometry(stamp_ns: int, x_m: float) -> Odometry:
    return builders.odometry(stamp_ns=stamp_ns, x_m=x_m)


def positions(*messages: StaticTransform | Odometry, frame_id: str = "map") -> CameraPoseLookup:
    made = CameraPoseLookup(frame_id, required=False)
    for message in messages:
        assert not made.add_transform(message)
    return made


def matrix_of(made: CameraPoseLookup, stamp_ns: int = 0) -> F64:
    placement = made.lookup(CAMERA, stamp_ns)
    assert placement is not None
    return placement.matrix


def test_a_camera_without_a_transform_is_the_origin_unless_one_is_required() -> None:
    made = positions()
    np.testing.assert_array_equal(matrix_of(made), LINK_FROM_OPTICAL)
    assert made.without_transform == {CAMERA}
    strict = CameraPoseLookup("map", required=True)
    assert strict.lookup(CAMERA, 0) is None
    assert strict.without_transform == {CAMERA}


def test_a_transform_that_comes_late_moves_the_camera() -> None:
    made = positions()
    matrix_of(made)
    assert made.add_transform(fixed("map", CAMERA, 2.0))
    assert matrix_of(made)[0, 3] == 2.0
    assert made.without_transform == set()
    assert not made.add_transform(fixed("map", CAMERA, 2.0))
    assert made.add_transform(fixed("map", CAMERA, 3.0))


def test_transform_before_the_first_frame_resets_nothing() -> None:
    made = positions(fixed("map", CAMERA, 2.0))
    assert not made.add_transform(fixed("map", CAMERA, 3.0))
    assert matrix_of(made)[0, 3] == 3.0


def test_a_base_that_drives_carries_its_camera() -> None:
    mount = fixed("base_link", CAMERA, 0.2)
    made = positions(mount, odometry(0, 1.0), odometry(500 * MS, 2.0), frame_id="odom")
    assert matrix_of(made, 250 * MS)[0, 3] == pytest.approx(1.7)
    assert not made.awaits_sample(CAMERA, 500 * MS)
    assert made.awaits_sample(CAMERA, 501 * MS)
    assert not made.add_transform(odometry(1000 * MS, 3.0))
    assert made.fixed == {}


def test_base_without_a_transform_to_map_is_reported() -> None:
    made = positions(fixed("base_link", CAMERA, 0.2), odometry(100, 1.0))
    np.testing.assert_array_equal(matrix_of(made, 100), LINK_FROM_OPTICAL)
    assert made.without_transform == {CAMERA}
    assert made.counters["motion_duplicates"] == 0


def test_restored_poses_hold_until_transforms_come() -> None:
    before = positions(fixed("map", CAMERA, 2.0))
    matrix_of(before)
    made = positions()
    made.restore(before.fixed)
    assert matrix_of(made)[0, 3] == 2.0
    assert made.without_transform == set()
    assert not made.add_transform(fixed("map", CAMERA, 2.0))
    assert made.add_transform(fixed("map", CAMERA, 2.5))
