"""Gestures of the arms, visible points of a body, and the true footfalls."""

from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from common.geometry.transforms import apply
from lab.drawing.renderer import draw_depth
from lab.motion.gait import step_length_m
from lab.scenario import Gesture, PersonPlan, Scenario, Waypoint
from lab.truth.frames import visible_points
from lab.truth.motion_capture import footfalls
from lab.world import World
from people4d.messages import F64

pytestmark = pytest.mark.render

WRISTS = (9, 10)  # left, right, COCO
STANDING = Scenario(
    about="One stands and faces the camera.",
    duration_s=6.0,
    people=(PersonPlan(body="bea", start=(3.0, 0.0)),),
)


def standing(*gestures: Gesture) -> World:
    return World(replace(STANDING, people=(replace(STANDING.people[0], gestures=gestures),)))


def wrists(of: World, times_s: F64) -> F64:
    return np.array([of.keypoints_m(float(t))[0][list(WRISTS)] for t in times_s])


def test_hand_goes_before_the_torso_and_back() -> None:
    # Faces the camera, so her right is +y, and before the trunk is -x.
    of = standing(Gesture(at_s=1.0, for_s=4.0, hand="right"))
    hanging, there, back = wrists(of, np.array([0.5, 3.0, 5.5]))
    chest_m = of.keypoints_m(3.0)[0][[5, 6]].mean(axis=0)
    assert abs(there[1, 1] - chest_m[1]) < 0.1 < hanging[1, 1] - chest_m[1]
    assert 0.15 < chest_m[0] - there[1, 0] < 0.45
    assert there[1, 2] > hanging[1, 2] + 0.2
    np.testing.assert_allclose(back[1], hanging[1], atol=0.03)
    np.testing.assert_allclose(there[0], hanging[0], atol=0.03)  # the other arm hangs


def test_a_hand_is_raised_above_the_head() -> None:
    of = standing(Gesture(at_s=1.0, hand="left", move="raise"))
    there = wrists(of, np.array([3.0]))[0]
    nose_m = of.keypoints_m(3.0)[0][0]
    assert there[0, 2] > nose_m[2] + 0.1
    assert there[1, 2] < nose_m[2] - 0.4


@pytest.mark.parametrize("move", ["before_torso", "raise"])
def test_hands_move_within_human_limits(move: str) -> None:
    # Quick arm movements reach 6 m/s; a calm gesture stays well below 3, without jumps: the
    # acceleration of a minimum-jerk way of 1 m in 1 s is 5.8 m/s2, and it swings on an arc.
    of = standing(Gesture(at_s=1.0, hand="right", move=move))  # type: ignore[arg-type]
    velocity = np.diff(wrists(of, np.arange(0, 6, 0.02))[:, 1], axis=0) / 0.02
    acceleration = np.diff(velocity, axis=0) / 0.02
    assert 0.4 < np.linalg.norm(velocity, axis=1).max() < 3.0
    assert np.linalg.norm(acceleration, axis=1).max() < 20.0


def test_a_gesture_leaves_the_rest_of_the_body_as_it_is() -> None:
    with_it, without = standing(Gesture(at_s=1.0)), standing()
    unchanged = [k for k in range(17) if k not in (8, 10)]  # right elbow and wrist
    now = [of.keypoints_m(3.0)[0][unchanged] for of in (with_it, without)]
    # The shoulder girdle follows the arm a little.
    np.testing.assert_allclose(now[0], now[1], atol=0.02)


def test_point_is_visible_from_its_side_only() -> None:
    of = standing()
    (mesh,) = of.meshes(0.0)
    chest_m = of.keypoints_m(0.0)[0][[5, 6]].mean(axis=0) - (0, 0, 0.1)
    sides_m = chest_m + np.array([[-0.3, 0, 0], [0.3, 0, 0]])
    nearest = [np.linalg.norm(mesh.vertices_m - side_m, axis=1).argmin() for side_m in sides_m]
    view = draw_depth([of.room.mesh, mesh], of.optical_from_map(0.0), of.info, 0.05)
    points_m = apply(of.optical_from_map(0.0), mesh.vertices_m[nearest])
    assert visible_points(of, points_m, view.depth_m, view.owners, 0).tolist() == [1, 0]
    assert visible_points(of, points_m, view.depth_m, view.owners, 1).tolist() == [0, 0]


def test_footfalls_alternate_at_the_length_of_the_gait_table() -> None:
    route = PersonPlan(body="adam", start=(0, 0), face_deg=0, path=(Waypoint(to=(8, 0)),))
    of = World(replace(STANDING, room="hall", duration_s=7.0, people=(route,)))
    found = footfalls(of, 0)
    assert all(a.side != b.side and a.time_s < b.time_s for a, b in pairwise(found))
    # In the middle of the path he walks at 1 m/s; his own cadence deviates by up to 5 %.
    steady = [fall for fall in found if 2.0 < fall.time_s < 6.0]
    lengths = [b.position_m[0] - a.position_m[0] for a, b in pairwise(steady)]
    expected = float(step_length_m(1.0, of.bodies[0].skeleton.stature_m))
    np.testing.assert_allclose(lengths, expected, rtol=0.07)
