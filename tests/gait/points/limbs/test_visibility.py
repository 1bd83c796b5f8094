"""Visibility by evidence of known kind."""

from dataclasses import replace

import numpy as np
import pytest

from services.gait.points.keypoints import Anchor
from services.gait.points.limbs.visibility import (
    VISIBILITY,
    WITHOUT_KEYPOINTS,
    LimbEvidence,
    shank_points_away,
)
from tests.gait.builders import INFO, mesh_of
from tests.gait.points.test_body import arm

# Evidence of a hand or foot off the body, at its keypoint, in front of the other limb.
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


@pytest.mark.parametrize(("end", "likely"), [(1.0, True), (0.4, False)])
def test_hand_in_an_unusual_pose_is_likely_at_a_distinct_end(end: float, likely: bool) -> None:
    unusual = CLEAR._replace(keypoint=0.0, has_keypoint=0.0, off_pixel=4.0, end=end)
    assert (WITHOUT_KEYPOINTS["hand"].odds(unusual) > 0) == likely


@pytest.mark.parametrize(
    ("ankle_m", "away"),
    [((0.0, 0.10, 2.2), True), ((0.0, 0.10, 2.05), False), ((0.0, 0.40, 2.2), False)],
)
def test_shank_points_away_if_it_is_short_in_the_image_and_its_ankle_is_farther(
    ankle_m: tuple[float, float, float], away: bool
) -> None:
    # The shank of a person of 1.7 m is 0.42 m long; it is at most 0.21 m long in the image.
    mesh = mesh_of([(0.0, 0.0, 2.0), ankle_m], [(0, 1)])
    body, (knee, ankle) = replace(arm(), mesh=mesh, stature_m=1.7), np.rint(mesh.pixels_px)
    anchor = Anchor(ankle, 1.0, 0.9, ankle, knee)
    assert shank_points_away(anchor, body, INFO) == away
    assert not shank_points_away(replace(anchor, before=None), body, INFO)
