"""Which end of a limb is which point's."""

import numpy as np

from services.gait.points.config import DepthLayerConfig
from services.gait.points.limbs import LimbEnd
from services.gait.points.matching import match
from services.gait.points.point_filter import PointFilter
from services.gait.points.point_motion import PointMotion
from tests.gait.bodies import INFO

CONFIG = DepthLayerConfig()
ALONG_M = 0.7


def hand(name: str, x_m: float) -> PointFilter:
    """A point that is followed, 0.7 m along the body."""
    point = PointFilter(name, CONFIG, INFO, np.random.default_rng(0))
    point.motion = PointMotion(np.array([x_m, 0.0, 2.0]), 1e-4 * np.eye(3), 0.1, 1.0)
    point.along_m, point.below_m, point.state = ALONG_M - 0.09, 0.09, "measured"
    return point


def end(basin: int, x_m: float, along_m: float = ALONG_M) -> LimbEnd:
    return LimbEnd(basin, "hand", np.array([x_m, 0.0, 2.0]), along_m, 1.0)


def test_each_point_gets_the_end_that_it_is_near() -> None:
    points = [hand("left_hand", 0.3), hand("right_hand", -0.3)]
    found = match(points, [end(0, -0.28), end(1, 0.31)], {})
    assert {name: end.basin for name, end in found.items()} == {"left_hand": 1, "right_hand": 0}


def test_points_share_no_end() -> None:
    # Both are near the one end; the nearer has it, 2 against 8 cm.
    points = [hand("left_hand", 0.1), hand("right_hand", 0.0)]
    found = match(points, [end(0, 0.08)], {})
    assert {name: end.basin for name, end in found.items()} == {"left_hand": 0}


def test_together_they_go_the_least_way() -> None:
    # The left is 5 cm from both ends, the right 1 cm from end 0 and 11 cm from end 1.
    points = [hand("left_hand", 0.00), hand("right_hand", 0.06)]
    found = match(points, [end(0, 0.05), end(1, -0.05)], {})
    assert {name: end.basin for name, end in found.items()} == {"left_hand": 1, "right_hand": 0}


def test_what_is_out_of_reach_or_of_another_length_is_nobodys() -> None:
    assert match([hand("left_hand", 0.0)], [end(0, 0.6)], {}) == {}
    assert match([hand("left_hand", 0.0)], [end(0, 0.0, ALONG_M + 0.4)], {}) == {}  # four sigmas


def test_a_keypoint_decides_between_ends_that_are_as_near() -> None:
    ends = [end(0, -0.1), end(1, 0.1)]
    found = match([hand("left_hand", 0.0)], ends, {"left_hand": np.array([0.1, 0.0, 2.0])})
    assert found["left_hand"].basin == 1


def test_a_lost_point_has_no_end() -> None:
    point = hand("left_hand", 0.0)
    point.state = "lost"
    assert match([point], [end(0, 0.0)], {}) == {}
