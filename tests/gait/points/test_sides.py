"""Left and right that have each other's name."""

import numpy as np

from services.gait.points.config import DepthLayerConfig
from services.gait.points.point_filter import PointFilter
from services.gait.points.point_motion import PointMotion
from services.gait.points.sides import Sides
from tests.gait.bodies import INFO

TO_CAMERA = np.array([0.0, 0.0, -1.0])
FEET = ("left_foot", "right_foot")


def feet(left_x_m: float, right_x_m: float) -> dict[str, PointFilter]:
    points = {}
    for name, x_m in zip(FEET, (left_x_m, right_x_m), strict=True):
        point = PointFilter(name, DepthLayerConfig(), INFO, np.random.default_rng(0))
        point.motion = PointMotion(np.array([x_m, 0.8, 3.0]), 1e-4 * np.eye(3), 0.1, 1.0)
        point.state = "measured"
        points[name] = point
    return points


def test_feet_on_the_wrong_sides_are_told_after_a_while() -> None:
    # Who looks at the camera has the left foot at the picture's right. 20 cm count in full.
    sides = Sides(swap_s=0.15)
    crossed = feet(left_x_m=-0.1, right_x_m=0.1)
    told = [sides.wrong(crossed, TO_CAMERA, 0.04) for _ in range(4)]
    assert told == [[], [], [], [FEET]]  # 4 x 0.04 s > 0.15 s


def test_feet_that_are_hardly_apart_take_longer() -> None:
    # 3 cm of 12: a quarter of each frame counts.
    sides = Sides(swap_s=0.15)
    told = [sides.wrong(feet(-0.015, 0.015), TO_CAMERA, 0.04) for _ in range(16)]
    assert told.index([FEET]) == 15  # 16 x 0.01 s > 0.15 s


def test_right_sides_speak_for_themselves() -> None:
    sides = Sides(swap_s=0.15)
    assert all(not sides.wrong(feet(0.1, -0.1), TO_CAMERA, 0.04) for _ in range(20))


def test_nothing_is_told_where_the_way_a_person_faces_or_a_foot_is_unknown() -> None:
    sides = Sides(swap_s=0.15)
    crossed = feet(-0.1, 0.1)
    assert all(not sides.wrong(crossed, None, 0.04) for _ in range(20))
    crossed["left_foot"].state = "predicted"
    assert all(not sides.wrong(crossed, TO_CAMERA, 0.04) for _ in range(20))
