"""Visibility by evidence of known kind, and of ankles behind their shanks."""

import numpy as np
import pytest

from services.gait.points.body import MeasuredBody, measure_body
from services.gait.points.keypoints import Anchor
from services.gait.points.limbs.visibility import (
    VISIBILITY,
    WITHOUT_KEYPOINTS,
    LimbEvidence,
    shank_points_away,
)
from services.gait.surface.geodesic import geodesic_extrema, geodesic_m
from tests.gait.builders import INFO, mesh_of

# A hand or foot beside the body, at its keypoint, before the other one.
CLEAR = LimbEvidence(
    keypoint=0.8,
    has_keypoint=1.0,
    keypoint_off_m=0.02,
    before_other=0.15,
    beside_other=0.4,
    off=0.5,
    off_other=3.0,
    off_pixel=0.5,
    before_body=0.0,
    before=0.0,
    own_end=1.0,
    off_along_m=0.03,
    end=1.0,
)


@pytest.mark.parametrize("kind", ["hand", "foot"])
def test_clear_point_is_visible(kind: str) -> None:
    assert VISIBILITY[kind].odds(CLEAR) >= VISIBILITY[kind].least


@pytest.mark.parametrize("kind", ["hand", "foot"])
@pytest.mark.parametrize(
    "change",
    [
        {"keypoint": 0.0, "has_keypoint": 0.0, "keypoint_off_m": 0.15, "before_other": -0.4},
        {"keypoint_off_m": 0.3, "keypoint": 0.45, "off_pixel": 2.0},
        {
            "before_other": -0.3,
            "beside_other": 0.03,
            "off_along_m": 0.4,
            "off": 3.0,
            "keypoint": 0.4,
        },
    ],
)
def test_point_without_evidence_is_not(kind: str, change: dict[str, float]) -> None:
    assert VISIBILITY[kind].odds(CLEAR._replace(**change)) < VISIBILITY[kind].least


@pytest.mark.parametrize("kind", ["hand", "foot"])
def test_without_keypoints_the_end_of_a_limb_is_visible_where_it_is_expected(kind: str) -> None:
    own = WITHOUT_KEYPOINTS[kind]
    beside = CLEAR._replace(keypoint=0.0, has_keypoint=0.0, keypoint_off_m=0.15)
    assert own.odds(beside) >= own.least
    assert own.odds(beside._replace(off=4.0, off_pixel=2.0)) < own.least
    assert own.odds(beside._replace(before_other=-0.3, beside_other=0.03)) < own.least


def leg(ankle_m: tuple[float, float, float]) -> tuple[MeasuredBody, Anchor]:
    """A person of 1.8 m with a knee 3 m away, and an ankle somewhere."""
    mesh = mesh_of([(0.0, -0.4, 3.0), (0.0, 0.5, 3.0), ankle_m], [(0, 1), (1, 2)])
    distance_m = geodesic_m(mesh, 0)
    extrema = geodesic_extrema(mesh, distance_m, 0.06)
    body = measure_body(mesh, np.array([1.8, 0.5, 0.1]), 1.8, distance_m, extrema)
    knee, ankle = (np.rint(mesh.pixels_px[k]) for k in (1, 2))
    return body, Anchor(ankle, 1.0, 0.9, ankle, knee)


@pytest.mark.parametrize(
    ("ankle_m", "away"),
    [
        ((0.0, 0.9, 3.05), False),  # below the knee, as when it stands
        ((0.0, 0.62, 3.4), True),  # behind it, in a swing towards the camera
        ((0.0, 0.55, 2.6), False),  # before it: the sole points to the camera
        ((0.35, 0.65, 3.15), False),  # beside it: a swing across the view
    ],
)
def test_ankle_is_behind_a_shank_that_points_away(
    ankle_m: tuple[float, float, float], away: bool
) -> None:
    body, anchor = leg(ankle_m)
    assert shank_points_away(anchor, body, INFO) == away


def test_shank_of_unknown_knee_or_off_the_body_does_not_point_away() -> None:
    body, anchor = leg((0.0, 0.62, 3.4))
    assert anchor.joint is not None
    assert not shank_points_away(None, body, INFO)
    assert not shank_points_away(Anchor(anchor.pixel, 1.0, 0.9, anchor.joint), body, INFO)
    off = Anchor(anchor.pixel, 1.0, 0.9, anchor.joint, anchor.joint + 80.0)
    assert not shank_points_away(off, body, INFO)


@pytest.mark.parametrize(("end", "likely"), [(1.0, True), (0.4, False)])
def test_hand_in_an_unusual_pose_is_likely_at_a_distinct_end(end: float, likely: bool) -> None:
    unusual = CLEAR._replace(keypoint=0.0, has_keypoint=0.0, off_pixel=4.0, end=end)
    assert (WITHOUT_KEYPOINTS["hand"].odds(unusual) > 0) == likely
