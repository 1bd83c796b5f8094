"""Rooms: closed, furnished where no person walks, different by seed."""

import math

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, invert, rotation_from_rpy, transform_from
from lab.drawing.furniture import SEAT_M
from lab.drawing.renderer import draw_depth
from lab.drawing.rooms import room_mesh
from lab.scenario import WALKABLE_M, RoomName
from people4d.messages import F64
from tests import builders

pytestmark = pytest.mark.render

INFO = builders.camera_info(width=80, height=60, fx=40.0, cx=39.5, cy=29.5)


def optical_from_map(x_m: float, y_m: float, z_m: float, pitch_deg: float, yaw_deg: float) -> F64:
    rotation = rotation_from_rpy(0.0, math.radians(pitch_deg), math.radians(yaw_deg))
    return invert(transform_from([x_m, y_m, z_m], rotation) @ LINK_FROM_OPTICAL)


@pytest.mark.parametrize("kind", ["lab", "hall", "office", "square"])
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_room_is_closed_on_all_sides(kind: str, seed: int) -> None:
    room = room_mesh(kind, seed)
    for yaw_deg in (0, 90, 180, 270):
        for pitch_deg in (0, 70, -70):
            pose = optical_from_map(1.5, 0.2, 1.2, pitch_deg, yaw_deg)
            depth = draw_depth([room.mesh], pose, INFO, 0.05).depth_m
            assert np.isfinite(depth).all()


@pytest.mark.parametrize("kind", ["lab", "hall", "office", "square"])
def test_floor_is_at_zero_and_walls_at_the_corners(kind: str) -> None:
    room = room_mesh(kind, 0)
    np.testing.assert_allclose(room.mesh.vertices_m.min(axis=0), room.low_m, atol=1e-9)
    np.testing.assert_allclose(room.mesh.vertices_m.max(axis=0), room.high_m, atol=1e-9)
    assert room.low_m[2] == 0.0
    # Straight down from 1.2 m, between the boards' joints, is the floor.
    depth = draw_depth([room.mesh], optical_from_map(1.5, 0.2, 1.2, 90, 0), INFO, 0.05).depth_m
    assert depth[30, 40] == pytest.approx(1.2, abs=1e-5)


def test_the_lab_is_the_room_of_the_scenarios() -> None:
    room = room_mesh("lab", 0)
    np.testing.assert_allclose([room.low_m[:2], room.high_m[:2]], [[-0.6, -1.75], [5.6, 1.75]])


@pytest.mark.parametrize("kind", ["lab", "hall", "office", "square"])
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_nothing_stands_where_people_walk(kind: RoomName, seed: int) -> None:
    mesh = room_mesh(kind, seed).mesh
    corners = mesh.vertices_m[mesh.faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    (x0, y0), (x1, y1) = WALKABLE_M[kind]
    inside = (low[:, 0] < x1) & (high[:, 0] > x0) & (low[:, 1] < y1) & (high[:, 1] > y0)
    at_body_height = (low[:, 2] < 2.0) & (high[:, 2] > 0.01)
    assert not (inside & at_body_height).any()


@pytest.mark.parametrize("seed", range(6))
def test_stools_are_at_the_given_positions(seed: int) -> None:
    without, with_stool = room_mesh("lab", seed), room_mesh("lab", seed, [(3.0, 0.8)])
    added = with_stool.mesh.vertices_m[
        (np.abs(with_stool.mesh.vertices_m[:, :2] - (3.0, 0.8)) < 0.25).all(axis=1)
        & (with_stool.mesh.vertices_m[:, 2] > 0)
        & (with_stool.mesh.vertices_m[:, 2] < 2.0)
    ]
    assert added[:, 2].max() == pytest.approx(SEAT_M)
    assert len(with_stool.mesh.vertices_m) > len(without.mesh.vertices_m)


@pytest.mark.parametrize("kind", ["lab", "hall", "office"])
def test_seeds_give_different_rooms_and_one_seed_always_the_same(kind: str) -> None:
    colours = [room_mesh(kind, seed).mesh.colour.tobytes() for seed in (0, 0, 1, 2)]
    assert colours[0] == colours[1]
    assert len(set(colours)) == 3
    sides = {float(room_mesh(kind, seed).lights[-1].position_m[1]) > 0 for seed in range(8)}
    assert sides == {True, False}  # windows on the left or on the right


@pytest.mark.parametrize("kind", ["lab", "hall", "office", "square"])
def test_normals_of_a_mirrored_room_point_inwards(kind: str) -> None:
    for seed in range(4):
        mesh = room_mesh(kind, seed).mesh
        corners = mesh.vertices_m[mesh.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert ((across * mesh.normals[mesh.faces[:, 0]]).sum(axis=1) > 0).mean() > 0.95
