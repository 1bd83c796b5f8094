"""Keypoints of ankles near and far from where the body expects its feet."""

from collections.abc import Mapping

import numpy as np
import pytest

from common.geometry.transforms import project
from people4d.messages import F64
from services.gait.points.keypoints import LEFT_FOOT, RIGHT_FOOT, Anchor
from services.gait.points.limbs.anchors import keep_own_limbs
from services.gait.points.normal import Normal
from services.gait.points.point_filter import PointFilter
from tests.gait.builders import INFO

FEET_M = {LEFT_FOOT: np.array([0.2, 0.9, 3.0]), RIGHT_FOOT: np.array([-0.2, 0.9, 3.0])}
SIGMA_M = 0.1


def feet() -> Mapping[str, PointFilter]:
    """Two feet 40 cm apart, expected by the body to 10 cm."""
    found = {}
    for name, position_m in FEET_M.items():
        found[name] = PointFilter(name)
        found[name].prior = Normal(position_m, SIGMA_M**2 * np.eye(3))
    return found


def left_anchor(position_m: F64, confidence: float) -> dict[str, Anchor]:
    pixel = project(position_m, INFO)[0]
    return {LEFT_FOOT: Anchor(pixel, 1.0, confidence, pixel)}


@pytest.mark.parametrize(
    ("aside_m", "confidence", "counts"),
    [
        (0.0, 0.2, True),
        (0.15, 0.2, True),
        (0.6, 0.2, False),  # far from both feet
        (-0.3, 0.2, False),  # at the right foot
        (0.6, 0.6, True),  # a confident keypoint overrides the body's expectation
    ],
)
def test_doubtful_ankle_counts_near_its_own_foot_only(
    aside_m: float, confidence: float, counts: bool
) -> None:
    found = left_anchor(FEET_M[LEFT_FOOT] + (aside_m, 0.0, 0.0), confidence)
    assert (LEFT_FOOT in keep_own_limbs(found, feet(), 0.0, INFO)) == counts


def test_of_two_ankles_on_one_foot_the_confident_one_counts() -> None:
    # Between both feet, nearer to the left one.
    between_m = FEET_M[LEFT_FOOT] + (-0.15, 0.0, 0.0)
    pixel = project(between_m, INFO)[0]
    found = {LEFT_FOOT: Anchor(pixel, 1.0, 0.2, pixel), RIGHT_FOOT: Anchor(pixel, 1.0, 0.7, pixel)}
    assert set(keep_own_limbs(found, feet(), 0.0, INFO)) == {RIGHT_FOOT}


def test_doubtful_ankle_of_a_person_who_is_not_known_does_not_count() -> None:
    points = feet()
    for point in points.values():
        point.prior = None
    found = left_anchor(FEET_M[LEFT_FOOT], 0.2)
    assert not keep_own_limbs(found, points, 0.0, INFO)
