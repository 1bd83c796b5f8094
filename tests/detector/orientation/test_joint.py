"""Joint likelihood of the yaw: by hand, mirrored, hidden."""

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from common.geometry.transforms import wrap
from people4d.messages import F32, F64, U16
from services.detector.orientation.joint import (
    ANGLES,
    EARS_M,
    NOSE_M,
    best_angles,
    expected_across,
    expected_along,
    joint_yaws,
    log_likelihood,
    sigma_factors,
)
from services.detector.orientation.observation import JointOffsets, YawObservations, observe_bodies
from services.detector.position.surface import DepthImage
from tests import builders

FX = 600.0
INFO = builders.camera_info(width=641, height=481, fx=FX, cx=320.0, cy=240.0)
NAN: F64 = np.array([math.nan])
LAYER_M: F64 = np.array([3.0])
UNKNOWN = JointOffsets(NAN, NAN)
MIRRORED = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15]


def at(values: F64, angle_deg: int) -> float:
    """Return what is expected at an angle, one of `ANGLES`."""
    return float(values[(angle_deg + 180) // 3 % len(ANGLES)])


def offsets(across_m: float, along_m: float) -> JointOffsets:
    return JointOffsets(np.array([across_m]), np.array([along_m]))


def observed_as(**changed: Any) -> YawObservations:
    """Return the observation of one person at 3 m with only these values known."""
    fields: dict[str, Any] = {
        "z_m": np.array([3.0]),
        "pairs": {"shoulders": UNKNOWN, "hips": UNKNOWN},
        **dict.fromkeys(("nose_m", "ears_m", "side"), NAN),
        "ray_rad": np.zeros(1),
    }
    own = {name: np.array([v]) if isinstance(v, float) else v for name, v in changed.items()}
    return YawObservations(**fields | own)


def observation(angle_deg: int, **changed: Any) -> YawObservations:
    """Return the expected observation of a body at an angle."""
    pairs = {
        name: offsets(at(expected_across(name), angle_deg), at(expected_along(name), angle_deg))
        for name in ("shoulders", "hips")
    }
    turned = math.radians(angle_deg)
    nose_m, ears_m = NOSE_M * math.sin(turned), EARS_M * math.cos(turned)
    fields: dict[str, Any] = {"pairs": pairs, "nose_m": nose_m, "ears_m": ears_m}
    return observed_as(**fields | changed)


def best(body: YawObservations) -> tuple[float, float]:
    """Return the most likely angle and its standard deviation."""
    (angle_rad,), (sigma_rad,) = best_angles(log_likelihood(body, FX))
    return float(angle_rad), float(sigma_rad)


def found_deg(body: YawObservations) -> float:
    angle_rad, sigma_rad = best(body)
    assert math.isfinite(sigma_rad)
    return math.degrees(wrap(angle_rad))


def test_expected_distance_across() -> None:
    # From behind it is 0.32 m to the right, from the front as much to the left. In profile, facing
    # left, it is the nearer one, marked 0.01 m ahead of the other: to the left.
    expected = {0: 0.32, -180: -0.32, 90: -0.01, -90: -0.01}
    assert {a: round(at(expected_across("shoulders"), a), 9) for a in expected} == expected


def test_expected_distance_along() -> None:
    # 45 deg before facing the camera: the joint is 0.32 sin 135 = 0.22627 m farther and as much to
    # the left. cos is -0.70711, so (1 + cos) / 2 = 0.14645 is the fraction of the gain from behind:
    # 0.87 - 0.24 * 0.14645 = 0.83485. Hidden is exp(-(0.22627 / 0.145)^2) = 0.08759.
    # 0.83485 * 0.22627 * 0.91241 = 0.17236.
    assert at(expected_along("shoulders"), 135) == pytest.approx(0.17236, abs=1e-4)
    # In profile only the nearer arm is visible; from the front both arms are at the same depth.
    for angle_deg in (-180, -90, 0, 90):
        assert at(expected_along("hips"), angle_deg) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("angle_deg", range(-180, 180, 15))
def test_expected_observation_gives_its_angle(angle_deg: int) -> None:
    error_deg = math.degrees(wrap(math.radians(found_deg(observation(angle_deg)) - angle_deg)))
    assert abs(error_deg) < 4.0


def test_the_face_gives_the_side_of_a_profile() -> None:
    profile = {"shoulders": offsets(-0.01, 0.0), "hips": offsets(-0.04, 0.0)}
    left = found_deg(observed_as(pairs=profile, nose_m=0.08, ears_m=0.0))
    right = found_deg(observed_as(pairs=profile, nose_m=-0.08, ears_m=0.0))
    assert left == pytest.approx(90, abs=4)
    assert right == pytest.approx(-90, abs=4)


def test_a_head_turned_aside_turns_the_body_a_little_only() -> None:
    looking = observation(-180, nose_m=0.08 * math.sin(math.radians(130)), ears_m=-0.08)
    assert 165 < abs(found_deg(looking)) <= 180


def test_without_measurements_there_is_no_angle() -> None:
    assert best(observed_as())[1] == math.inf


def test_depth_gives_the_side_without_a_face() -> None:
    # The image shows a person facing half left, depth a person facing half right.
    body = observation(135, nose_m=math.nan, ears_m=math.nan)
    wrong = {name: JointOffsets(p.across_m, -p.along_m) for name, p in body.pairs.items()}
    body = replace_fields(body, pairs=wrong)
    assert found_deg(body) == pytest.approx(-135, abs=4)
    unread = {name: JointOffsets(p.across_m, NAN) for name, p in body.pairs.items()}
    (flat,) = log_likelihood(replace_fields(body, pairs=unread), FX)
    assert at(flat, 135) == pytest.approx(at(flat, -135))


def test_reversals_are_likelier_where_the_network_is_not_confident_of_a_side() -> None:
    offsets_by_side = [
        log_likelihood(replace_fields(observation(30), side=np.array([side])), FX)[0]
        for side in (0.9, 0.3, 0.05)
    ]
    ratios = [at(log_p, 30) - at(log_p, -150) for log_p in offsets_by_side]
    assert ratios[0] == pytest.approx(math.log(0.97 / 0.03), abs=0.05)
    assert ratios[1] == pytest.approx(math.log(0.88 / 0.12), abs=0.05)
    assert ratios[2] == pytest.approx(0.0, abs=0.05)


def test_sigma_grows_where_the_network_is_not_confident_of_a_side() -> None:
    # 0.6 / 0.3 = 2.
    for side, factor in ((0.3, 2.0), (0.7, 1.0), (0.0, 1.0), (math.nan, 1.0)):
        assert sigma_factors(observed_as(side=side)) == pytest.approx(factor)


# From images


def scene(right_m: float = -0.3, hidden: bool = False) -> tuple[F32, U16]:
    """Return keypoints and depth of a person at 3 m, right joints at a distance to the right.

    The right half of the body is 0.1 m farther than the left half, or occluded.
    """
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[7:, 2] = 0.8  # arms and legs
    half_px = right_m / 2 * FX / 3
    for left, right, share, v in ((5, 6, 1.0, 180), (11, 12, 0.6, 280)):
        keypoints[left] = 320 - share * half_px, v, 0.8
        keypoints[right] = 320 + share * half_px, v, 0.8
    depth = np.full((481, 641), 3000, np.uint16)
    side = np.s_[:, :320] if right_m < 0 else np.s_[:, 321:]
    depth[side] = 1500 if hidden else 3100
    return keypoints, depth


def observed(keypoints: F32, depth: U16, ray_rad: float = 0.0) -> YawObservations:
    """Return the observation by a camera whose axis is turned by this angle from the body."""
    info = replace(INFO, cx=INFO.cx + FX * math.tan(ray_rad))
    return observe_bodies(keypoints[None], LAYER_M, DepthImage(depth, info))


def test_pairs_are_measured_from_the_ray_to_the_torso() -> None:
    keypoints, depth = scene()
    body = observed(keypoints, depth)
    assert body.pairs["shoulders"].across_m == pytest.approx(-0.3, abs=1e-6)
    assert body.pairs["shoulders"].along_m == pytest.approx(0.1, abs=1e-6)
    assert np.isnan(body.nose_m).all()
    # Seen along a line 0.2 rad to the left: across 0.3 cos 0.2, and the left joint, which is to the
    # right, is 0.3 sin 0.2 farther along that line, so the right one is nearer by that much:
    # 0.1 / cos 0.2 + 0.3 sin 0.2 as the line goes through the middle of both.
    body = observed(keypoints, depth, 0.2)
    assert body.pairs["shoulders"].across_m == pytest.approx(-0.3 * math.cos(0.2), abs=1e-6)
    expected_m = 0.1 / math.cos(0.2) + 0.3 * math.sin(0.2)
    assert body.pairs["shoulders"].along_m == pytest.approx(expected_m, abs=1e-6)


def test_hidden_joints_do_not_count() -> None:
    keypoints, depth = scene(hidden=True)
    body = observed(keypoints, depth)
    assert all(np.isnan(pair.across_m).all() for pair in body.pairs.values())
    keypoints, depth = scene()
    keypoints[6, 0] = -50  # outside of the image
    body = observed(keypoints, depth)
    assert np.isnan(body.pairs["shoulders"].across_m).all()
    # The line of sight is to the three joints inside of the image.
    assert body.pairs["hips"].across_m == pytest.approx(-0.18, abs=2e-3)


def test_a_mirrored_image_mirrors_the_angle() -> None:
    keypoints, depth = scene()
    mirrored = keypoints[MIRRORED].copy()
    mirrored[:, 0] = 640 - mirrored[:, 0]
    flipped = DepthImage(depth[:, ::-1].copy(), INFO)
    (one,) = joint_yaws(keypoints[None], LAYER_M, DepthImage(depth, INFO))
    (other,) = joint_yaws(mirrored[None], LAYER_M, flipped)
    assert one is not None
    assert other is not None
    assert one.rad == pytest.approx(-other.rad, abs=1e-6)
    assert one.rad > math.radians(120)
    assert one.sigma_rad == pytest.approx(other.sigma_rad)


def test_yaw_in_the_optical_frame_is_independent_of_the_column() -> None:
    keypoints, depth = scene()
    aside = replace(INFO, cx=INFO.cx + FX * math.tan(0.2))
    found = [joint_yaws(keypoints[None], LAYER_M, DepthImage(depth, i)) for i in (INFO, aside)]
    ahead, beside = (one for (one,) in found if one is not None)
    assert wrap(ahead.rad - beside.rad) == pytest.approx(0.0, abs=0.1)


def test_joints_of_little_confidence_give_a_less_certain_yaw() -> None:
    keypoints, depth = scene()
    faint = keypoints.copy()
    keypoints[:, 2], faint[:, 2] = 0.9, 0.3
    image = DepthImage(depth, INFO)
    (clear,) = joint_yaws(keypoints[None], LAYER_M, image)
    (unclear,) = joint_yaws(faint[None], LAYER_M, image)
    assert clear is not None
    assert unclear is not None
    assert unclear.rad == pytest.approx(clear.rad, abs=0.01)
    assert unclear.sigma_rad > 2 * clear.sigma_rad  # 0.6 / 0.3, and the chance of a reversal
    faint[:, 2] = 0.1
    assert joint_yaws(faint[None], LAYER_M, image) == [None]


def test_an_empty_depth_image_gives_no_yaw_by_shoulders_and_hips() -> None:
    keypoints, depth = scene()
    empty = DepthImage(np.zeros_like(depth), INFO)
    assert joint_yaws(keypoints[None], LAYER_M, empty) == [None]


def test_people_are_measured_as_each_alone() -> None:
    keypoints, depth = scene()
    aside = keypoints.copy()
    aside[:, 0] -= 100
    aside[6, 2] = 0.1  # not confident
    image, layers_m = DepthImage(depth, INFO), np.array([3.0, 3.05, 2.9])
    people = np.array([keypoints, aside, np.zeros_like(keypoints)])
    together = joint_yaws(people, layers_m, image)
    alone = [joint_yaws(people[k : k + 1], layers_m[k : k + 1], image)[0] for k in range(3)]
    assert together == alone
    assert together[2] is None


def replace_fields(body: YawObservations, **changed: Any) -> YawObservations:
    return YawObservations(**{f: getattr(body, f) for f in YawObservations.__slots__} | changed)
