"""Hands and feet behind their keypoints, on an arm of a few vertices."""

from dataclasses import replace

import numpy as np
import pytest

from common.geometry.transforms import project
from people4d.messages import F64
from services.gait.points.body import Extremity, MeasuredBody
from services.gait.points.kalman import PointKalmanFilter
from services.gait.points.keypoints import Anchor
from services.gait.points.limbs.surface import head_position, nearest_position, surface_position
from services.gait.points.point_filter import PointFilter
from tests.gait.builders import INFO
from tests.gait.points.test_body import arm

UP = np.array([0.0, -1.0, 0.0])
AHEAD = np.array([1.0, 0.0, 0.0])
WRIST = 12  # index of a vertex; a vertex of the forearm is 15 cm before it
FOREARM = 7


def anchor_at(vertex: int, before: int | None) -> Anchor:
    pixels = arm().mesh.pixels_px
    known = None if before is None else pixels[before].astype(float)
    joint = pixels[vertex].astype(float)
    return Anchor(joint, 1.0, 0.8, joint, known)


def test_hand_is_beyond_the_wrist_at_its_depth() -> None:
    body = arm()
    found = surface_position("left_hand", anchor_at(WRIST, FOREARM), body, None, UP, INFO)
    assert found is not None
    wrist, elbow = body.mesh.points_m[[WRIST, FOREARM]]
    assert found.position_m == pytest.approx(wrist + 0.4 * (wrist - elbow), abs=0.01)
    assert found.vertex == WRIST


def test_hand_of_unknown_forearm_is_at_the_wrist() -> None:
    body = arm()
    found = surface_position("left_hand", anchor_at(WRIST, None), body, None, UP, INFO)
    assert found is not None
    assert found.position_m == pytest.approx(body.mesh.points_m[WRIST], abs=1e-6)


def test_hand_beyond_the_body_is_at_the_wrist() -> None:
    # Beyond the last vertex there is no body: the hand is hidden, bent or in a pocket.
    body = arm()
    last = len(body.mesh.points_m) - 1
    found = surface_position("left_hand", anchor_at(last, FOREARM), body, None, UP, INFO)
    assert found is not None
    assert found.position_m == pytest.approx(body.mesh.points_m[last], abs=1e-6)


def test_foot_is_ahead_of_the_ankle_and_below() -> None:
    body = arm()
    found = surface_position("left_foot", anchor_at(WRIST, FOREARM), body, AHEAD, UP, INFO)
    assert found is not None
    ankle = body.mesh.points_m[WRIST]
    ray = ankle / np.linalg.norm(ankle)
    # 5.5 cm from the surface to the ankle, 8 cm ahead, 3 cm down, 3 cm back to the surface.
    assert found.position_m == pytest.approx(ankle + 0.025 * ray + 0.08 * AHEAD - 0.03 * UP)


def test_foot_is_followed_through_its_swing() -> None:
    # 1.3 m in 0.4 s, with accelerations of 40 m/s^2 where the foot lifts off and lands.
    anchor = replace(anchor_at(WRIST, FOREARM), confidence=1.0)
    found = surface_position("left_foot", anchor, arm(), AHEAD, UP, INFO)
    assert found is not None
    motion = PointKalmanFilter(np.zeros(3), found.noise_m2, 1.5, 12.0)
    off_m = []
    for t_s in np.arange(-15, 13) / 30:
        x_m = 0.65 * (1 - np.cos(np.pi * max(t_s, 0.0) / 0.4))
        motion.predict(1 / 30)
        motion.correct(np.array([x_m, 0.0, 0.0]), found.noise_m2)
        off_m.append(abs(motion.position_m[0] - x_m))
    assert max(off_m) < 0.02


def with_depths(changed_m: dict[int, float]) -> MeasuredBody:
    """Return the arm with other depths of some vertices at the same pixels."""
    body = arm()
    points_m = body.mesh.points_m.copy()
    for vertex, depth_m in changed_m.items():
        points_m[vertex] *= depth_m / points_m[vertex, 2]
    return replace(body, mesh=replace(body.mesh, points_m=points_m))


def test_hand_of_a_forearm_that_points_to_the_camera_is_nearer_than_the_wrist() -> None:
    hands = range(WRIST + 1, WRIST + 4)
    body = with_depths(dict.fromkeys(hands, 1.94))
    found = surface_position("left_hand", anchor_at(WRIST, FOREARM), body, None, UP, INFO)
    assert found is not None
    assert found.position_m[2] == pytest.approx((2.0 + 1.94) / 2)


@pytest.mark.parametrize(("ahead_m", "share"), [(AHEAD, 0.5), (np.array([0.0, 0.0, 1.0]), 0.0)])
def test_foot_is_between_its_ankle_and_the_surface_before_it(ahead_m: F64, share: float) -> None:
    # If a foot points away, the visible surface is its heel.
    body = arm()
    info, ankle = INFO, body.mesh.points_m[WRIST]
    free = surface_position("left_foot", anchor_at(WRIST, FOREARM), body, ahead_m, UP, info)
    assert free is not None
    # The vertex at the foot's pixel is 6 cm nearer to the camera than the ankle.
    grid = body.mesh.grid.copy()
    column, row = (project(free.position_m, info)[0] + 0.5).astype(int) // body.mesh.step_px
    assert grid[row, column] < 0
    grid[row, column] = 0
    points_m = body.mesh.points_m.copy()
    points_m[0, 2] = ankle[2] - 0.06
    covered = replace(body, mesh=replace(body.mesh, grid=grid, points_m=points_m))
    found = surface_position("left_foot", anchor_at(WRIST, FOREARM), covered, ahead_m, UP, info)
    assert found is not None
    moved_m = share * (points_m[0, 2] - free.position_m[2])
    assert found.position_m[2] == pytest.approx(free.position_m[2] + moved_m)


def test_keypoint_off_the_body_measures_nothing() -> None:
    anchor = Anchor(np.zeros(2), 1.0, 0.8, np.array([5000.0, 0.0]))
    assert surface_position("left_hand", anchor, arm(), None, UP, INFO) is None
    assert surface_position("left_hand", None, arm(), None, UP, INFO) is None


def test_head_is_behind_its_face_and_else_at_its_end() -> None:
    body = arm()
    end = Extremity(0, "head", body.mesh.points_m[FOREARM], 0.6, 1.0)
    face, other = (
        head_position(anchor, end, body, INFO) for anchor in (anchor_at(WRIST, None), None)
    )
    assert face is not None
    assert other is not None
    assert face.position_m == pytest.approx(body.mesh.points_m[WRIST])
    assert other.position_m == pytest.approx(body.mesh.points_m[FOREARM])
    assert head_position(None, None, body, INFO) is None


def test_hand_without_keypoint_and_end_is_as_far_along_the_body_as_before() -> None:
    # 3 cm between vertices: 5 vertices off is 15 cm, farther than the prediction allows.
    body, point = arm(), PointFilter("left_hand")
    assert nearest_position(point, body) is None
    point.start_at_vertex(WRIST, body)
    found = nearest_position(point, body)
    assert found is not None
    assert found.vertex == WRIST
    assert point.motion is not None
    point.motion.state[:3] += (0.6, 0.0, 0.0)
    assert nearest_position(point, body) is None
