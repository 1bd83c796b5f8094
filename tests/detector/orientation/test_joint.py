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
    EXPECTED_M,
    NOSE_M,
    best_angles,
    joint_yaws,
    log_likelihood,
    sigma_factors,
)
from services.detector.orientation.observation import YawObservations, observe_bodies
from services.detector.position.surface import DepthImage
from tests import builders

FX = 600.0
INFO = builders.camera_info(width=641, height=481, fx=FX, cx=320.0, cy=240.0)
NAN: F64 = np.array([math.nan])
LAYER_M: F64 = np.array([3.0])
MIRRORED = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15]


def at(values: F64, angle_deg: int) -> float:
    """Return what is expected at an angle, one of `ANGLES`."""
    return float(values[(angle_deg + 180) // 3 % len(ANGLES)])


def observed_as(**changed: Any) -> YawObservations:
    """Return the observation of one person at 3 m with only these values known."""
    fields: dict[str, Any] = {
        "z_m": np.array([3.0]),
        **dict.fromkeys(("shoulders_m", "nose_m", "ears_m", "side"), NAN),
        "ray_rad": np.zeros(1),
    }
    own = {name: np.array([v]) if isinstance(v, float) else v for name, v in changed.items()}
    return YawObservations(**fields | own)


def observation(angle_deg: int, **changed: Any) -> YawObservations:
    """Return the expected observation of a body at an angle."""
    shoulders_m = at(EXPECTED_M, angle_deg)
    turned = math.radians(angle_deg)
    nose_m, ears_m = NOSE_M * math.sin(turned), EARS_M * math.cos(turned)
    fields: dict[str, Any] = {"shoulders_m": shoulders_m, "nose_m": nose_m, "ears_m": ears_m}
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
    assert {a: round(at(EXPECTED_M, a), 9) for a in expected} == expected


@pytest.mark.parametrize("angle_deg", range(-180, 180, 15))
def test_expected_observation_gives_its_angle(angle_deg: int) -> None:
    found_rad, sigma_rad = best(observation(angle_deg))
    assert abs(wrap(found_rad - math.radians(angle_deg))) < sigma_rad / 2
    # Widths say little from the front and from behind.
    assert math.degrees(sigma_rad) < 19.0
    assert abs(angle_deg) not in range(60, 135) or math.degrees(sigma_rad) < 11.0


def test_the_face_gives_the_side_of_a_profile() -> None:
    left = found_deg(observed_as(shoulders_m=-0.01, nose_m=0.08, ears_m=0.0))
    right = found_deg(observed_as(shoulders_m=-0.01, nose_m=-0.08, ears_m=0.0))
    assert left == pytest.approx(90, abs=4)
    assert right == pytest.approx(-90, abs=4)


def test_a_head_turned_aside_turns_the_body_a_little_only() -> None:
    looking = observation(-180, nose_m=0.08 * math.sin(math.radians(130)), ears_m=-0.08)
    assert 155 < abs(found_deg(looking)) <= 180


def test_without_measurements_there_is_no_angle() -> None:
    assert best(observed_as())[1] == math.inf


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


def scene(right_m: float = -0.3, hidden: bool = False, face: bool = True) -> tuple[F32, U16]:
    """Return keypoints and depth of a person at 3 m, right joints at a distance to the right.

    The face looks 30 deg to the left of the camera. The right half of the body may be occluded.
    """
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[7:, 2] = 0.8  # arms and legs
    if face:
        for point, offset_m in ((0, -0.04), (3, 0.054), (4, -0.054)):
            keypoints[point] = 320 + offset_m * FX / 3, 120, 0.8
    half_px = right_m / 2 * FX / 3
    for left, right, share, v in ((5, 6, 1.0, 180), (11, 12, 0.6, 280)):
        keypoints[left] = 320 - share * half_px, v, 0.8
        keypoints[right] = 320 + share * half_px, v, 0.8
    depth = np.full((481, 641), 3000, np.uint16)
    if hidden:
        depth[:, :320] = 1500
    return keypoints, depth


def observed(keypoints: F32, depth: U16, ray_rad: float = 0.0) -> YawObservations:
    """Return the observation by a camera whose axis is turned by this angle from the body."""
    info = replace(INFO, cx=INFO.cx + FX * math.tan(ray_rad))
    return observe_bodies(keypoints[None], LAYER_M, DepthImage(depth, info))


def test_shoulders_are_measured_across_the_ray_to_the_torso() -> None:
    keypoints, depth = scene()
    body = observed(keypoints, depth)
    assert body.shoulders_m[0] == pytest.approx(-0.3, abs=1e-6)
    assert (body.nose_m[0], body.ears_m[0]) == pytest.approx((0.04, -0.108), abs=1e-6)
    # Seen along a line 0.2 rad to the left: 0.3 cos 0.2.
    body = observed(keypoints, depth, 0.2)
    assert body.shoulders_m[0] == pytest.approx(-0.3 * math.cos(0.2), abs=1e-6)


def test_hidden_shoulders_do_not_count() -> None:
    keypoints, depth = scene(hidden=True)
    assert np.isnan(observed(keypoints, depth).shoulders_m).all()
    keypoints, depth = scene()
    keypoints[6, 0] = -50  # outside of the image
    assert np.isnan(observed(keypoints, depth).shoulders_m).all()


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


@pytest.mark.parametrize("right_m", [-1.0, 0.0, 1.0])
def test_yaw_in_the_optical_frame_is_independent_of_the_column(right_m: float) -> None:
    # A body at 3 m turns its chest 60 deg to the left of facing away: forward is to the left.
    forward, left = np.array([-math.sin(1.05), math.cos(1.05)]), np.array([-0.5, -0.866])
    keypoints = np.full((17, 3), (320 + FX * right_m / 3, 300, 0.8), np.float32)
    ahead_m = {0: 0.08, 3: 0.0, 4: 0.0, 5: 0.0, 6: 0.0}
    beside_m = {0: 0.0, 3: 0.0625, 4: -0.0625, 5: 0.16, 6: -0.16}
    for k, ahead in ahead_m.items():
        x_m, z_m = np.array([right_m, 3.0]) + ahead * forward + beside_m[k] * left
        keypoints[k] = 320 + FX * x_m / z_m, 200, 0.8
    depth = np.full((481, 641), 3000, np.uint16)
    (found,) = joint_yaws(keypoints[None], LAYER_M, DepthImage(depth, INFO))
    assert found is not None
    assert found.rad == pytest.approx(1.05, abs=0.15)


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


def test_without_face_and_depth_there_is_no_yaw() -> None:
    keypoints, depth = scene(face=False)
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
