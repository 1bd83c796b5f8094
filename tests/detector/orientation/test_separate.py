"""Yaw by separate estimates: by hand, mirrored, turned, tilted, and without readings."""

import math

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, project, rotation_from_rpy, wrap
from people4d.messages import F32, F64, U16
from services.detector.config import CONFIDENCE_MIN
from services.detector.orientation.angle import YawEstimate, bearings, heading_vector
from services.detector.orientation.separate import (
    FACE,
    MOVENET_FACE,
    YawPair,
    face_rule,
    face_sign,
    ratio_angle,
    ratio_yaw,
    separate_yaws,
    torso_height,
    vector_yaw,
)
from services.detector.position.surface import DepthImage
from tests import builders

INFO = builders.camera_info(width=641, height=481, cx=320.0, cy=240.0)
NOSE, L_EYE, R_EYE, L_EAR, R_EAR, L_SHOULDER, R_SHOULDER, L_HIP, R_HIP = (*range(7), 11, 12)
MIRRORED = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15]


def degrees(angle: YawEstimate | None) -> float | None:
    return None if angle is None else round(math.degrees(angle.rad), 6)


def points(**at: tuple[float, float, float]) -> F64:
    """Return 17 keypoints, all unknown except the named ones."""
    known = np.full((17, 3), np.nan)
    for name, point in at.items():
        known[globals()[name.upper()]] = point
    return known


def torso(shoulders_px: float, hips_px: float, height_px: float, u: float = 320.0) -> F64:
    """Return pixels (17x2) of a torso, its right side this far to the right of its left."""
    pixels = np.full((17, 2), np.nan)
    for left, right, width, v in (
        (L_SHOULDER, R_SHOULDER, shoulders_px, 100.0),
        (L_HIP, R_HIP, hips_px, 100.0 + height_px),
    ):
        pixels[left], pixels[right] = (u - width / 2, v), (u + width / 2, v)
    return pixels


def keypoints_of(*indices: int, nose_u: float = 0.0) -> F32:
    """Return keypoints, only the given ones confident; ears at u 40 and 60."""
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[list(indices), 2] = 0.9
    keypoints[[NOSE, L_EAR, R_EAR], 0] = nose_u, 60, 40
    return keypoints


def projected(yaw_rad: float, x_m: float = 3.0, y_m: float = 0.0) -> tuple[F32, U16]:
    """Return keypoints and depth of a torso 0.5 m high that faces a way, at x, y of the camera.

    Shoulders 0.45 m (0.9 of the height) and hips 0.33 m (0.66) wide; no face.
    """
    keypoints, depth = np.zeros((17, 3), np.float32), np.zeros((481, 641), np.uint16)
    to_right = np.array([math.sin(yaw_rad), -math.cos(yaw_rad), 0.0])
    for left, right, width_m, z_m in (
        (L_SHOULDER, R_SHOULDER, 0.45, 0.25),
        (L_HIP, R_HIP, 0.33, -0.25),
    ):
        for index, side in ((left, -0.5), (right, 0.5)):
            point = np.array([x_m, y_m, z_m]) + side * width_m * to_right
            u, v = project(point @ LINK_FROM_OPTICAL[:3, :3], INFO)[0]
            keypoints[index] = u, v, 0.9
            depth[round(v), round(u)] = round(point[0] * 1000)
    return keypoints, depth


# psi_1


@pytest.mark.parametrize(
    ("right", "expected_deg"),
    [
        ((3.0, 0.2, 0.0), 180.0),  # facing the camera, the right shoulder is image-left:
        # d = (0, 0.4, 0), atan2(0, -0.4) = 180
        ((3.0, -0.6, 0.0), 0.0),  # facing away: d = (0, -0.4, 0), atan2(0, 0.4) = 0
        ((3.4, -0.2, 0.0), 90.0),  # facing image-left, the right shoulder is the far one:
        # d = (0.4, 0, 0), atan2(0.4, 0) = 90
        ((2.6, -0.2, 0.0), -90.0),  # facing image-right: the near one
        ((3.3, 0.1, 0.5), 135.0),  # d = (0.3, 0.3, .), atan2(0.3, -0.3) = 135, height plays no part
    ],
)
def test_vector_of_the_shoulders(right: tuple[float, float, float], expected_deg: float) -> None:
    left = (3.0, -0.2, 0.0)
    found = vector_yaw(points(l_shoulder=left, r_shoulder=right))
    assert found is not None
    assert math.degrees(found.rad) == pytest.approx(expected_deg)
    # The hips point the other way: they are ignored while shoulders are known.
    hips = points(l_hip=right, r_hip=left, l_shoulder=left, r_shoulder=right)
    assert vector_yaw(hips) == found
    # If a shoulder is unknown, the hips give the yaw: d is reversed.
    hips[L_SHOULDER] = np.nan
    turned = vector_yaw(hips)
    assert turned is not None
    assert abs(wrap(turned.rad - found.rad)) == pytest.approx(math.pi)


def test_a_pair_nearer_than_0_1_m_is_refused() -> None:
    # |d| = 0.099 m: one shoulder hides the other, and one hip the other: they are not used.
    close = points(
        l_shoulder=(3, 0, 0), r_shoulder=(3.099, 0, 0), l_hip=(3, 0, 0), r_hip=(3.3, 0, 0)
    )
    assert vector_yaw(close) is None
    close[R_SHOULDER] = 3.101, 0, 0
    assert degrees(vector_yaw(close)) == 90.0
    # |d| counts in 3D, but two points above each other have no direction.
    assert vector_yaw(points(l_shoulder=(3, 0, 0), r_shoulder=(3, 0, 0.5))) is None
    assert vector_yaw(points(l_shoulder=(3, 0, 0))) is None


def test_a_longer_pair_has_a_smaller_sigma() -> None:
    # sigma = sqrt(2) 0.05 / |d|: 0.1414 + 0.0354 of 0.4 m = 0.1768 rad; twice that for 0.2 m.
    wide = vector_yaw(points(l_shoulder=(3, 0, 0), r_shoulder=(3, 0.4, 0)))
    narrow = vector_yaw(points(l_shoulder=(3, 0, 0), r_shoulder=(3, 0.2, 0)))
    assert wide is not None
    assert narrow is not None
    assert wide.sigma_rad == pytest.approx(0.1768, abs=1e-4)
    assert narrow.sigma_rad == pytest.approx(2 * wide.sigma_rad)


# psi_2


@pytest.mark.parametrize(
    ("shoulders_px", "hips_px", "expected_deg"),
    [
        (90.0, 66.0, 0.0),  # 0.9 / 0.9 = 1 and 0.66 / 0.66 = 1: from behind
        (-90.0, -66.0, 180.0),  # the right side is left: facing the camera
        (0.0, 0.0, 90.0),  # in profile
        (45.0, 0.0, 75.0),  # arccos(0.5) = 60 and arccos(0) = 90, mean 75
        (-120.0, math.nan, 180.0),  # clipped to -1; no hips: the shoulders alone
    ],
)
def test_ratios(shoulders_px: float, hips_px: float, expected_deg: float) -> None:
    pixels = torso(shoulders_px, hips_px, 100.0)
    pixels[[L_HIP, R_HIP], 1] = 200.0
    if math.isnan(hips_px):
        pixels[R_HIP] = np.nan  # the left side still gives the height
        pixels[L_HIP, 0] = 300.0
    assert torso_height(pixels) == 100.0
    found = ratio_angle(pixels, torso_height(pixels))
    assert found is not None
    assert math.degrees(found) == pytest.approx(expected_deg)


def test_height_needs_a_shoulder_and_the_hip_below_it() -> None:
    pixels = torso(90.0, 66.0, 100.0)
    pixels[L_HIP] = pixels[R_SHOULDER] = np.nan
    assert torso_height(pixels) == -math.inf
    assert ratio_yaw(pixels, 0.0, 1, None) is None


def test_a_person_lying_or_upside_down_has_no_ratio() -> None:
    for height_px in (7.9, 0.0, -100.0):
        assert ratio_yaw(torso(90, 66, height_px), 0.0, 1, None) is None


@pytest.mark.parametrize(
    ("indices", "sign"),
    [
        ((L_EAR,), 1),  # image-left is +: the camera sees the left side
        ((L_EYE,), 1),
        ((R_EAR,), -1),
        ((R_EYE,), -1),
        ((L_EAR, L_EYE, R_EYE), 1),  # three quarters: both eyes but one ear
        ((R_EAR, L_EYE, R_EYE), -1),
        ((L_EAR, R_EAR), 0),  # from the front, or from behind
        ((L_EYE, R_EYE), 0),  # both rules of eq. 4.17 hold
        ((L_EYE, R_EAR), -1),
        ((), 0),
    ],
)
def test_sign_by_visible_eyes_and_ears(indices: tuple[int, ...], sign: int) -> None:
    assert face_sign(keypoints_of(*indices), 100.0, FACE) == sign


def test_sign_by_the_nose() -> None:
    # The ears' middle is at 50. The nose at 44 is 6 px image-left of it, 5 of 100 px are needed.
    rule, face = MOVENET_FACE, (NOSE, L_EAR, R_EAR)
    assert face_sign(keypoints_of(*face, nose_u=44), 100.0, rule) == 1
    assert face_sign(keypoints_of(*face, nose_u=56), 100.0, rule) == -1
    assert face_sign(keypoints_of(*face, nose_u=46), 100.0, rule) == 0
    assert face_sign(keypoints_of(NOSE, L_EAR, nose_u=44), 100.0, rule) == 0


def test_the_angle_counts_from_the_ray() -> None:
    # u = 320 - 600: the ray points 45 deg to the left. Profile, left ear seen: 90 + 45.
    pixels = torso(0.0, 0.0, 100.0, u=-280.0)
    unknown = np.full_like(pixels, np.nan)
    ray_rad, straight_rad = bearings(np.stack([pixels, unknown]), INFO).tolist()
    assert math.degrees(ray_rad) == pytest.approx(45.0)
    assert straight_rad == 0.0
    assert degrees(ratio_yaw(pixels, ray_rad, 1, None)) == 135.0
    assert degrees(ratio_yaw(pixels, ray_rad, -1, None)) == -45.0


def test_without_a_face_the_sign_is_that_of_the_vector_along_the_ray() -> None:
    pixels = torso(0.0, 0.0, 100.0)
    # 30 deg in the frame lie 15 deg to the right of a ray at 45: the sign is -.
    vector = YawEstimate(math.radians(30), 0.1)
    found = ratio_yaw(pixels, math.radians(45), 0, vector)
    assert degrees(found) == -45.0  # -90 + 45
    assert degrees(ratio_yaw(pixels, 0.0, 0, vector)) == 90.0
    assert degrees(ratio_yaw(pixels, 0.0, -1, vector)) == -90.0
    assert ratio_yaw(pixels, 0.0, 0, None) is None


def test_profiles_have_a_smaller_sigma_than_fronts() -> None:
    # sigma_r / sin(psi): 0.18 at 90 deg; at 180 deg sin is not taken below sqrt(0.18) = 0.424.
    side = ratio_yaw(torso(0, 0, 100), 0.0, 1, None)
    front = ratio_yaw(torso(-90, -66, 100), 0.0, 1, None)
    assert side is not None
    assert front is not None
    assert side.sigma_rad == pytest.approx(0.18)
    assert front.sigma_rad == pytest.approx(0.424, abs=1e-3)


# Fusion


def test_fusion_is_a_circular_mean() -> None:
    # The plain mean of -175 and 175 deg would be 0.
    both = YawPair(YawEstimate(math.radians(-175), 0.3), YawEstimate(math.radians(175), 0.4)).fuse()
    assert both is not None
    assert abs(math.degrees(both.rad)) == pytest.approx(180.0)
    # Mean of independent errors: sqrt(0.3^2 + 0.4^2) / 2 = 0.25.
    assert both.sigma_rad == pytest.approx(0.25)
    assert degrees(YawPair(YawEstimate(1.0, 0.3), None).fuse()) == 57.29578  # 1 rad
    assert YawPair(None, None).fuse() is None
    assert YawPair(YawEstimate(math.pi / 2, 0.3), YawEstimate(-math.pi / 2, 0.3)).fuse() is None


def test_angles_that_disagree_have_a_larger_sigma() -> None:
    # 1 rad apart, sigmas 0.3 and 0.4 explain 0.5: the sigma of 0.25 doubles.
    fused = YawPair(YawEstimate(0.0, 0.3), YawEstimate(1.0, 0.4)).fuse()
    assert fused is not None
    assert fused.sigma_rad == pytest.approx(0.5)


# All together


def measured(yaw_deg: float, **at: float) -> YawPair:
    keypoints, depth = projected(math.radians(yaw_deg), **at)
    return separate_yaws(keypoints, DepthImage(depth, INFO), CONFIDENCE_MIN, FACE)


@pytest.mark.parametrize("yaw_deg", range(-175, 180, 25))
@pytest.mark.parametrize("y_m", [0.0, -0.8, 1.0])
def test_yaw_of_a_projected_torso_is_measured(yaw_deg: float, y_m: float) -> None:
    found = measured(yaw_deg, y_m=y_m)
    if abs(abs(yaw_deg) - 90) > 15:  # else the shoulders may be 0.1 m or less apart
        assert found.vector is not None
        assert abs(math.degrees(wrap(found.vector.rad - math.radians(yaw_deg)))) < 1.0
    # The ratio assumes a distant camera on the optical axis. Its error is largest near 0 and 180
    # deg.
    if found.ratio is not None:
        assert abs(math.degrees(wrap(found.ratio.rad - math.radians(yaw_deg)))) < 25.0


def test_the_ray_is_added_beside_the_axis() -> None:
    # In profile at 2 m, 1.1 m to the left: the ray points 28.8 deg to the left of the axis.
    keypoints, depth = projected(math.radians(90 + 28.8), 2.0, 1.1)
    keypoints[L_EAR] = 100, 100, 0.9
    blind = DepthImage(np.zeros_like(depth), INFO)
    found = separate_yaws(keypoints, blind, CONFIDENCE_MIN, FACE)
    assert found.vector is None
    assert found.ratio is not None
    assert math.degrees(found.ratio.rad) == pytest.approx(118.8, abs=3)


@pytest.mark.parametrize("yaw_deg", [-160, -100, -30, 20, 70, 130, 175])
def test_the_mirror_image_has_the_mirrored_yaw(yaw_deg: float) -> None:
    keypoints, depth = projected(math.radians(yaw_deg), y_m=0.3)
    keypoints[L_EAR], keypoints[R_EYE] = (300, 80, 0.9), (310, 80, 0.9)
    mirrored = keypoints[MIRRORED]
    mirrored[:, 0] = 640 - mirrored[:, 0]  # the optical axis is at 320
    one = separate_yaws(keypoints, DepthImage(depth, INFO), CONFIDENCE_MIN, FACE).fuse()
    other = separate_yaws(mirrored, DepthImage(depth[:, ::-1], INFO), CONFIDENCE_MIN, FACE).fuse()
    assert one is not None
    assert other is not None
    assert other.rad == pytest.approx(-one.rad)
    assert other.sigma_rad == pytest.approx(one.sigma_rad)


def test_missing_keypoints_and_depth() -> None:
    keypoints, depth = projected(math.radians(140))
    blind = separate_yaws(keypoints, DepthImage(np.zeros_like(depth), INFO), CONFIDENCE_MIN, FACE)
    assert blind == YawPair(None, None)  # no vector, so no sign for the ratio either
    keypoints[L_EAR] = 300, 80, 0.9
    blind = separate_yaws(keypoints, DepthImage(np.zeros_like(depth), INFO), CONFIDENCE_MIN, FACE)
    assert blind.vector is None
    assert blind.ratio is not None
    keypoints[:, 2] = 0.0
    assert separate_yaws(keypoints, DepthImage(depth, INFO), CONFIDENCE_MIN, FACE).fuse() is None


def test_wild_keypoints_give_a_finite_angle_or_none() -> None:
    rng = np.random.default_rng(1)
    depth = rng.integers(0, 9000, (481, 641)).astype(np.uint16)
    for _ in range(300):
        keypoints = rng.normal(size=(17, 3)) * 10.0 ** rng.choice([0, 2, 30])
        keypoints[:, 2] = rng.random(17)
        found = separate_yaws(
            keypoints.astype(np.float32), DepthImage(depth, INFO), CONFIDENCE_MIN, FACE
        ).fuse()
        assert found is None or (-math.pi < found.rad <= math.pi and 0 < found.sigma_rad < 10)


# The heading on the wire


def direction(map_from_optical: F64, yaw_rad: float) -> float:
    x, y, _ = map_from_optical @ heading_vector(yaw_rad)
    return math.atan2(y, x)


def test_heading_vector_by_hand() -> None:
    # Optical: x right, y down, z forward. Away is +z, image-left is -x, to the camera is -z.
    for yaw_deg, expected in (
        (0, (0, 0, 1)),
        (90, (-1, 0, 0)),
        (180, (0, 0, -1)),
        (-90, (1, 0, 0)),
    ):
        np.testing.assert_allclose(heading_vector(math.radians(yaw_deg)), expected, atol=1e-12)


@pytest.mark.parametrize("turned_deg", [0, 90, -170])
def test_a_turned_camera_adds_its_own_yaw(turned_deg: float) -> None:
    # A camera that looks along the map's y (90 deg) sees a person from behind (0): they face y.
    turned = rotation_from_rpy(0, 0, math.radians(turned_deg)) @ LINK_FROM_OPTICAL[:3, :3]
    for yaw_deg in (0, 40, -120, 180):
        expected = wrap(math.radians(turned_deg + yaw_deg))
        found = direction(turned, math.radians(yaw_deg))
        assert wrap(found - expected) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("yaw_deg", range(-170, 190, 30))
@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(0, 35), (0, -20), (15, 25), (-10, 0)])
def test_a_tilted_camera_gives_the_same_direction(
    roll_deg: float, pitch_deg: float, yaw_deg: float
) -> None:
    # Level shoulders 0.4 m apart in the map, seen by a camera that looks down and leans.
    psi = math.radians(yaw_deg)
    map_from_link = rotation_from_rpy(math.radians(roll_deg), math.radians(pitch_deg), 0.5)
    to_right = 0.4 * np.array([math.sin(psi), -math.cos(psi), 0.0]) @ map_from_link
    left = np.array([3.0, 0.2, 0.1])
    shoulders = points(l_shoulder=tuple(left), r_shoulder=tuple(left + to_right))
    found = vector_yaw(shoulders)
    assert found is not None
    found_rad = direction(map_from_link @ LINK_FROM_OPTICAL[:3, :3], found.rad)
    assert wrap(found_rad - psi) == pytest.approx(0.0, abs=1e-9)


def test_face_rule_suits_the_model() -> None:
    assert face_rule("yolov8n-pose") == FACE == (False, 0.5)
    assert face_rule("movenet-multipose") == MOVENET_FACE == (True, 0.3)
