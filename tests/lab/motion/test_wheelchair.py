"""A person in a wheelchair sits, rolls along the path, and makes no steps."""

import numpy as np
import pytest

from lab.drawing.pieces import wheelchair
from lab.furniture import FOOTREST_M
from lab.motion.stance import seated_height_m
from lab.scenario import PersonPlan, Scenario, Waypoint
from lab.truth.motion_capture import footfalls
from lab.world import World

HIPS, KNEES, ANKLES = [11, 12], [13, 14], [15, 16]


@pytest.fixture(scope="module")
def world() -> World:
    """Return a world in which one person rolls 2 m ahead and 1 m to the side."""
    path = (Waypoint(to=(3.5, 0.0)), Waypoint(to=(3.5, 1.0)))
    bea = PersonPlan(body="bea", start=(1.5, 0.0), face_deg=0.0, path=path, wheelchair=True)
    return World(Scenario(about="One rolls.", duration_s=8.0, people=(bea,)))


def test_hips_are_above_the_path_at_the_height_of_the_seat(world: World) -> None:
    height_m = FOOTREST_M + seated_height_m(world.bodies[0].skeleton.stature_m)
    for t_s in (0.0, 2.0, 5.0, 7.9):
        hips_m = world.keypoints_m(t_s)[0][HIPS].mean(axis=0)
        assert hips_m[:2] == pytest.approx(world.motions[0].path(t_s)[0, :2], abs=0.06)
        assert hips_m[2] == pytest.approx(height_m, abs=0.06)


def test_body_is_rigid_while_it_rolls(world: World) -> None:
    """Knees are level with the hips, and distances between joints stay, except for the breath."""
    joints_m = np.array([world.keypoints_m(t)[0] for t in np.arange(0.0, 8.0, 0.5)])
    rises_m = joints_m[:, HIPS, 2] - joints_m[:, KNEES, 2]
    assert np.abs(rises_m).max() < 0.12
    legs_m = np.linalg.norm(joints_m[:, ANKLES] - joints_m[:, HIPS], axis=-1)
    assert np.ptp(legs_m) < 1e-3
    assert np.linalg.norm(joints_m[-1, 0] - joints_m[0, 0]) > 2


def test_there_are_no_footfalls(world: World) -> None:
    assert footfalls(world, 0) == []


def test_wheelchair_holds_the_person_and_stands_on_the_floor(world: World) -> None:
    low_m, high_m = wheelchair().vertices_m.min(axis=0), wheelchair().vertices_m.max(axis=0)
    assert low_m[2] == pytest.approx(0.0)
    assert 0.85 < high_m[2] < 1.0
    assert 0.55 < high_m[1] - low_m[1] < 0.7
    (chair,) = world.surfaces(5.0)[1:]
    at_m = world.motions[0].path(5.0)[0, :2]
    hub_m = (chair.vertices_m.min(axis=0) + chair.vertices_m.max(axis=0)) / 2
    assert np.linalg.norm(hub_m[:2] - at_m) < 0.25
    assert not chair.owner.any()
