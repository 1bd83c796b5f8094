"""Assignment of extremities to points."""

import numpy as np
import pytest

from services.gait.points.assignment import assign_points
from services.gait.points.body import Extremity
from services.gait.points.kalman import PointKalmanFilter
from services.gait.points.normal import Normal
from services.gait.points.point_filter import PointFilter

LENGTH_M = 0.7


def hand(name: str, x_m: float) -> PointFilter:
    """A tracked point, 0.7 m along the body."""
    point = PointFilter(name)
    point.motion = PointKalmanFilter(np.array([x_m, 0.0, 2.0]), 1e-4 * np.eye(3), 0.1, 1.0)
    point.geodesic_m, point.state = LENGTH_M - 0.09, "measured"
    return point


def extremity(basin: int, x_m: float, geodesic_m: float = LENGTH_M) -> Extremity:
    return Extremity(basin, "hand", np.array([x_m, 0.0, 2.0]), geodesic_m, 1.0)


def test_each_point_is_assigned_the_nearest_extremity() -> None:
    points = [hand("left_hand", 0.3), hand("right_hand", -0.3)]
    found = assign_points(points, [extremity(0, -0.28), extremity(1, 0.31)], {})
    assert {name: one.basin for name, one in found.items()} == {"left_hand": 1, "right_hand": 0}


def test_an_extremity_is_assigned_once() -> None:
    # Both points are near the extremity; the nearer point gets it, 2 against 8 cm.
    points = [hand("left_hand", 0.1), hand("right_hand", 0.0)]
    found = assign_points(points, [extremity(0, 0.08)], {})
    assert {name: one.basin for name, one in found.items()} == {"left_hand": 0}


def test_assignment_minimises_the_total_cost() -> None:
    # The left is 5 cm from both extremities, the right 1 cm from extremity 0, 11 cm from 1.
    points = [hand("left_hand", 0.00), hand("right_hand", 0.06)]
    found = assign_points(points, [extremity(0, 0.05), extremity(1, -0.05)], {})
    assert {name: one.basin for name, one in found.items()} == {"left_hand": 1, "right_hand": 0}


def test_extremity_out_of_reach_or_of_other_length_is_not_assigned() -> None:
    assert assign_points([hand("left_hand", 0.0)], [extremity(0, 0.6)], {}) == {}
    assert assign_points([hand("left_hand", 0.0)], [extremity(0, 0.0, LENGTH_M + 0.4)], {}) == {}


def test_keypoint_decides_between_equally_near_extremities() -> None:
    extremities = [extremity(0, -0.1), extremity(1, 0.1)]
    found = assign_points(
        [hand("left_hand", 0.0)], extremities, {"left_hand": np.array([0.1, 0.0, 2.0])}
    )
    assert found["left_hand"].basin == 1


def test_lost_or_unconnected_point_is_not_assigned() -> None:
    lost, unconnected = hand("left_hand", 0.0), hand("right_hand", 0.0)
    lost.state, unconnected.geodesic_m = "lost", float("nan")
    assert assign_points([lost, unconnected], [extremity(0, 0.0)], {}) == {}


@pytest.mark.parametrize("without_keypoints", [True, False])
def test_hand_without_keypoints_is_followed_off_its_hip(without_keypoints: bool) -> None:
    # In front of the torso the path along the body crosses the shoulder, and no prior expects it.
    point = hand("left_hand", 0.0)
    point.without_keypoints = without_keypoints
    point.prior = Normal(np.array([0.5, 0.0, 2.0]), 0.1**2 * np.eye(3))
    found = assign_points([point], [extremity(0, 0.02, LENGTH_M + 0.6)], {})
    assert set(found) == ({"left_hand"} if without_keypoints else set())
    assert assign_points([point], [extremity(0, 0.28, LENGTH_M + 0.6)], {}) == {}
