"""Which way a person faces by all that is seen at once: by hand, mirrored, hidden."""

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from common.geometry.transforms import wrap
from people4d.messages import F32, F64, U16, CameraInfo
from services.detector.orientation.body_angle import (
    ANGLES,
    BodyRule,
    across,
    along,
    best_angle,
    doubt,
    log_likelihood,
)
from services.detector.orientation.body_look import HIPS, SHOULDERS, Look, Pair, Viewer
from services.detector.orientation.orientation import OrientationRule, whole_body
from services.detector.position.position import Sight

RULE = BodyRule()
FX = 600.0
INFO = CameraInfo(
    stamp_ns=0,
    sequence=0,
    camera="front",
    frame_id="front_optical_frame",
    width=641,
    height=481,
    fx=FX,
    fy=FX,
    cx=320.0,
    cy=240.0,
)
UNKNOWN = Pair(math.nan, math.nan)
NOTHING = Look(3.0, {"shoulders": UNKNOWN, "hips": UNKNOWN}, math.nan, math.nan)
MIRRORED = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15]


def at(values: F64, angle_deg: int) -> float:
    """Return what is expected at an angle, one of `ANGLES`."""
    return float(values[(angle_deg + 180) // 3 % len(ANGLES)])


def seen(angle_deg: int, **changed: Any) -> Look:
    """Return how the body of the rule looks at an angle."""
    pairs = {
        name: Pair(at(across(pair), angle_deg), at(along(pair, RULE.hiding_m), angle_deg))
        for name, pair in RULE.pairs().items()
    }
    turned = math.radians(angle_deg)
    nose_m, ears_m = RULE.nose_m * math.sin(turned), RULE.ears_m * math.cos(turned)
    look: dict[str, Any] = {
        "z_m": 3.0,
        "pairs": pairs,
        "nose_m": nose_m,
        "ears_m": ears_m,
    } | changed
    return Look(**look)


def found_deg(look: Look, rule: BodyRule = RULE) -> float:
    best = best_angle(log_likelihood(look, FX, rule))
    assert best is not None
    return math.degrees(best[0])


def test_how_far_to_the_right_the_right_shoulder_is() -> None:
    # From behind it is 0.32 m to the right, from the front as much to the left. In profile, facing
    # left, it is the nearer one, marked 0.01 m ahead of the other: to the left.
    expected = {0: 0.32, -180: -0.32, 90: -0.01, -90: -0.01}
    assert {a: round(at(across(SHOULDERS), a), 9) for a in expected} == expected


def test_how_much_farther_the_right_shoulder_is() -> None:
    # 45 deg before facing the camera: the joint is 0.32 sin 135 = 0.22627 m farther and as much to
    # the left. cos is -0.70711, so (1 + cos) / 2 = 0.14645 is the share of the gain from behind:
    # 0.87 - 0.24 * 0.14645 = 0.83485. Hidden are exp(-(0.22627 / 0.145)^2) = 0.08759.
    # 0.83485 * 0.22627 * 0.91241 = 0.17236.
    assert at(along(SHOULDERS, 0.145), 135) == pytest.approx(0.17236, abs=1e-4)
    # In profile the nearer arm is all that is seen; from the front both are at the same depth.
    for angle_deg in (-180, -90, 0, 90):
        assert at(along(HIPS, 0.145), angle_deg) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("angle_deg", range(-180, 180, 15))
def test_a_body_that_looks_as_expected_is_seen_to_face_that_way(angle_deg: int) -> None:
    error_deg = math.degrees(wrap(math.radians(found_deg(seen(angle_deg)) - angle_deg)))
    assert abs(error_deg) < 4.0


def test_the_face_tells_the_side_of_a_profile() -> None:
    profile = {"shoulders": Pair(-0.01, 0.0), "hips": Pair(-0.04, 0.0)}
    left = found_deg(replace_look(NOTHING, pairs=profile, nose_m=0.08, ears_m=0.0))
    right = found_deg(replace_look(NOTHING, pairs=profile, nose_m=-0.08, ears_m=0.0))
    assert left == pytest.approx(90, abs=4)
    assert right == pytest.approx(-90, abs=4)


def test_a_head_turned_aside_turns_the_body_a_little_only() -> None:
    looking = seen(-180, nose_m=0.08 * math.sin(math.radians(130)), ears_m=-0.08)
    assert 165 < abs(found_deg(looking)) <= 180


def test_an_unsure_face_tells_who_is_seen_from_behind() -> None:
    # Shoulders the wrong way round look like those of somebody who faces the camera. A network is
    # surer of faces that it sees.
    sure, unsure = seen(-180, face=0.62), seen(-180, face=0.45)
    rule = replace(RULE, use_confidence=True)
    spread = [best_angle(log_likelihood(look, FX, rule)) for look in (sure, unsure)]
    assert spread[0] is not None
    assert spread[1] is not None
    assert spread[1][1] > 2 * spread[0][1]


def test_nothing_seen_tells_nothing() -> None:
    assert best_angle(log_likelihood(NOTHING, FX, RULE)) is None
    off = replace(RULE, use_shoulders=False, use_hips=False, use_head=False)
    assert best_angle(log_likelihood(seen(30), FX, off)) is None


def test_parts_are_switched_off() -> None:
    # Facing half to the left; depth is of somebody who faces half to the right.
    look = seen(135, nose_m=math.nan, ears_m=math.nan)
    wrong = {name: Pair(p.across_m, -p.along_m) for name, p in look.pairs.items()}
    look = replace_look(look, pairs=wrong)
    assert found_deg(look) == pytest.approx(-135, abs=4)
    flat = log_likelihood(look, FX, replace(RULE, use_depth=False))
    assert at(flat, 135) == pytest.approx(at(flat, -135))


def test_doubt_grows_where_the_network_is_not_sure_of_a_side() -> None:
    # (0.6 / 0.3)^2 = 4.
    assert doubt(replace_look(NOTHING, side=0.3), RULE) == pytest.approx(4.0)
    assert doubt(replace_look(NOTHING, side=0.7), RULE) == doubt(NOTHING, RULE) == 1.0


# From pictures


def scene(right_m: float = -0.3, hidden: bool = False) -> tuple[F32, U16]:
    """Return keypoints and depth of somebody at 3 m whose right joints are so far to the right.

    The right half of the body is 0.1 m farther than the left one, or somebody stands before it.
    """
    keypoints = np.zeros((17, 3), np.float32)
    half_px = right_m / 2 * FX / 3
    for left, right, share, v in ((5, 6, 1.0, 180), (11, 12, 0.6, 280)):
        keypoints[left] = 320 - share * half_px, v, 0.8
        keypoints[right] = 320 + share * half_px, v, 0.8
    depth = np.full((481, 641), 3000, np.uint16)
    side = np.s_[:, :320] if right_m < 0 else np.s_[:, 321:]
    depth[side] = 1500 if hidden else 3100
    return keypoints, depth


def viewer() -> Viewer:
    return Viewer({"shoulders": SHOULDERS, "hips": HIPS}, 0.3, RULE.reach_m)


def test_pairs_are_measured_from_the_line_of_sight() -> None:
    keypoints, depth = scene()
    look = viewer().look(keypoints, 3.0, 0.0, Sight(depth, INFO))
    assert look.pairs["shoulders"].across_m == pytest.approx(-0.3, abs=1e-6)
    assert look.pairs["shoulders"].along_m == pytest.approx(0.1, abs=1e-6)
    assert math.isnan(look.nose_m)
    # Seen along a line 0.2 rad to the left: across 0.3 cos 0.2, and the left joint, which is to the
    # right, is 0.3 sin 0.2 farther along that line, so the right one is nearer by that much:
    # 0.1 / cos 0.2 + 0.3 sin 0.2 as the line goes through the middle of both.
    look = viewer().look(keypoints, 3.0, 0.2, Sight(depth, INFO))
    assert look.pairs["shoulders"].across_m == pytest.approx(-0.3 * math.cos(0.2), abs=1e-6)
    expected_m = 0.1 / math.cos(0.2) + 0.3 * math.sin(0.2)
    assert look.pairs["shoulders"].along_m == pytest.approx(expected_m, abs=1e-6)


def test_joints_that_somebody_hides_do_not_count() -> None:
    keypoints, depth = scene(hidden=True)
    look = viewer().look(keypoints, 3.0, 0.0, Sight(depth, INFO))
    assert all(math.isnan(pair.across_m) for pair in look.pairs.values())
    keypoints, depth = scene()
    keypoints[6, 0] = -50  # outside of the image
    look = viewer().look(keypoints, 3.0, 0.0, Sight(depth, INFO))
    assert math.isnan(look.pairs["shoulders"].across_m)
    assert look.pairs["hips"].across_m == pytest.approx(-0.18, abs=1e-6)


def test_a_mirrored_picture_mirrors_the_angle() -> None:
    keypoints, depth = scene()
    mirrored = keypoints[MIRRORED].copy()
    mirrored[:, 0] = 640 - mirrored[:, 0]
    rule = OrientationRule(whole=True)
    one = whole_body(keypoints, 3.0, Sight(depth, INFO), rule, 0.3)
    other = whole_body(mirrored, 3.0, Sight(depth[:, ::-1].copy(), INFO), rule, 0.3)
    assert one is not None
    assert other is not None
    assert one.rad == pytest.approx(-other.rad, abs=1e-6)
    assert one.rad > math.radians(120)
    assert one.sigma_rad == pytest.approx(other.sigma_rad)


def test_an_empty_depth_image_tells_nothing_of_shoulders_and_hips() -> None:
    keypoints, depth = scene()
    rule = OrientationRule(whole=True)
    assert whole_body(keypoints, 3.0, Sight(np.zeros_like(depth), INFO), rule, 0.3) is None


@pytest.mark.parametrize(
    "wrong", [{"hiding_m": 0.0}, {"outliers_head": 1.0}, {"turned": 0.0}, {"ears_m": math.nan}]
)
def test_wrong_constants_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"^{next(iter(wrong))}: expected"):
        BodyRule(**wrong)  # type: ignore[arg-type]


def replace_look(look: Look, **changed: Any) -> Look:
    return Look(**{f: getattr(look, f) for f in Look.__slots__} | changed)
