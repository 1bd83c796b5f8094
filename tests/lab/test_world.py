import numpy as np
import pytest

from common.geometry.transforms import apply
from lab.catalogue import load_scenario
from lab.drawing.furniture import SEAT_M
from lab.world import EPOCH_NS, World
from tests.lab.worlds import world


def test_frames_are_stamped_from_the_epoch_at_the_frame_rate() -> None:
    # 266 frames at 15 Hz; the last is at 265 / 15 = 17.666667 s.
    of = world("pmrr")
    assert of.frame_count == 266
    assert of.stamp_ns(0) == EPOCH_NS
    assert of.stamp_ns(265) - EPOCH_NS == 17_666_666_667
    assert of.frame_s(3) == pytest.approx(0.2)


def test_camera_axis_points_forward() -> None:
    # The camera is at (0, 0, 1.15), level; a point 2 m ahead is in the middle of the image.
    of = world("facing")
    ahead = apply(of.optical_from_map(0.7), np.array([2.0, 0.0, 1.15]))
    np.testing.assert_allclose(ahead, [0, 0, 2], atol=1e-12)
    assert (of.info.cx, of.info.cy) == (319.5, 239.5)  # centres of pixels are whole numbers
    np.testing.assert_allclose(
        of.map_from_optical(0.7) @ of.optical_from_map(0.7), np.eye(4), atol=1e-12
    )


def test_geometry_needs_neither_room_nor_bodies() -> None:
    of = World(load_scenario("short_walk"))
    of.optical_from_map(1.0)
    assert not {"room", "bodies", "motions"} & set(vars(of))
    of.poses(1.0)
    assert "room" not in vars(of)


def test_another_seed_is_another_motion_and_room_on_the_same_paths() -> None:
    one, other = world("short_walk"), World(load_scenario("short_walk"), seed=99)
    assert other.seed == 99
    before, after = (of.poses(2.0)[0].map_from_pelvis for of in (one, other))
    assert 1e-6 < np.abs(before - after).max() < 0.2
    assert not np.array_equal(one.room.walls, other.room.walls)


def test_each_person_who_sits_has_a_stool() -> None:
    of = world("short_sit")
    x, y, z = of.room.mesh.vertices_m.T
    near = (np.hypot(x - 3.4, y - 0.7) < 0.3) & (z > 0.05)
    assert z[near].max() == pytest.approx(SEAT_M, abs=0.02)
    # Seated, the hips are a little above the seat; standing, twice as high.
    height = of.bodies[0].skeleton.stature_m
    hips_m = [of.poses(t)[0].map_from_pelvis[2, 3] for t in (0.0, 5.5)]
    assert hips_m[0] > 0.45 * height
    assert SEAT_M < hips_m[1] < SEAT_M + 0.2


def test_owners_count_people_from_one() -> None:
    assert [set(mesh.owner.tolist()) for mesh in world("facing").meshes(0.0)] == [{1}, {2}]
