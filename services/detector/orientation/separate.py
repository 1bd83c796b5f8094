"""Yaw by two separate estimates from keypoints (docs/method.md section 6 [PIC4SeR]).

psi_1 is from shoulders or hips in 3D, psi_2 from the proportions of the body in the image.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL, deproject, wrap
from people4d.messages import F32, F64
from services.detector.config import MOVENET
from services.detector.orientation.angle import (
    HIPS,
    LEFT_EAR,
    LEFT_EYE,
    NOSE,
    RIGHT_EAR,
    RIGHT_EYE,
    SHOULDERS,
    YawEstimate,
    bearings,
    confident_pixels,
)
from services.detector.position.surface import DepthImage, keypoint_depth

BASELINE_MIN_M = 0.1  # minimum distance of a pair; below it one joint hides the other [m]
SHOULDER_RATIO_MAX = 0.90  # maximum shoulder width over torso height [Winter 2009]
HIP_RATIO_MAX = 0.66  # maximum hip width over torso height [Winter 2009]
TORSO_MIN_PX = 8.0  # minimum height of a torso with readable proportions [px]
NOSE_OFFSET_MIN = 0.05  # minimum offset of the nose from the ears' middle, per torso height
# Standard deviations, from the simulated room
SIGMA_POINT_M = 0.05  # standard deviation of each point, across the pair [m]
SIGMA_RATIO = 0.18  # standard deviation of a ratio over its maximum


class FaceRule(NamedTuple):
    """Rule for the side to which a person is turned, from the face."""

    # True: side of the nose relative to the ears' middle; False: visible eyes and ears (4.17)
    by_nose: bool
    confidence_min: float  # minimum confidence of visible eyes, ears and nose


# MoveNet has the same confidence for hidden and visible ears: on 370 views in the simulated room,
# visibility gives a random side, the nose the correct one in 96 %
FACE, MOVENET_FACE = FaceRule(False, 0.5), FaceRule(True, 0.3)


def face_rule(model: str) -> FaceRule:
    """Return the rule that suits the people model of a name."""
    return MOVENET_FACE if model.startswith(MOVENET) else FACE


@dataclass(frozen=True, slots=True)
class YawPair:
    """Both estimates of one person; None if unknown."""

    vector: YawEstimate | None  # psi_1
    ratio: YawEstimate | None  # psi_2, the bearing added

    def fuse(self) -> YawEstimate | None:
        """Return the circular mean (eq. 4.18)."""
        psi = [angle for angle in (self.vector, self.ratio) if angle is not None]
        sines, cosines = (sum(f(angle.rad) for angle in psi) for f in (math.sin, math.cos))
        if math.hypot(sines, cosines) <= 1e-6 * len(psi):
            return None
        spread_rad = math.hypot(*(angle.sigma_rad for angle in psi))
        sigma_rad = spread_rad / len(psi)
        if len(psi) == 2:  # a difference larger than sigma raises sigma
            sigma_rad *= max(1.0, abs(wrap(psi[0].rad - psi[1].rad)) / spread_rad)
        return YawEstimate(wrap(math.atan2(sines, cosines)), sigma_rad)


def separate_yaws(
    keypoints: F32, image: DepthImage, confidence_min: float, face: FaceRule
) -> YawPair:
    """Estimate the yaw of a person by two methods.

    Keypoints are 17x3, u and v in pixels and confidence, COCO order.
    """
    depth_m = keypoint_depth(keypoints, image, confidence_min)
    points = deproject(keypoints[:, :2], depth_m, image.info) @ LINK_FROM_OPTICAL[:3, :3].T
    psi_1 = vector_yaw(points)
    pixels = confident_pixels(keypoints, confidence_min)
    ray_rad = float(bearings(pixels[None], image.info)[0])
    sign = face_sign(keypoints, torso_height(pixels), face)
    return YawPair(psi_1, ratio_yaw(pixels, ray_rad, sign, psi_1))


def vector_yaw(points_m: F64) -> YawEstimate | None:
    """Return psi_1 = atan2(d_x, -d_y), d = p_right - p_left of the shoulders, else of the hips.

    A d shorter than the baseline is rejected: one point hides the other. Keypoints are 17x3 in
    metres, body frame of the camera, NaN if unknown.
    """
    pairs = (points_m[right] - points_m[left] for left, right in (SHOULDERS, HIPS))
    d = next((pair for pair in pairs if np.isfinite(pair).all()), np.zeros(3))
    level_m = math.hypot(d[0], d[1])
    if np.linalg.norm(d) < BASELINE_MIN_M or level_m == 0:
        return None
    sigma_rad = min(math.sqrt(2) * SIGMA_POINT_M / level_m, math.pi)
    return YawEstimate(wrap(math.atan2(d[0], -d[1])), sigma_rad)


def ratio_yaw(
    pixels: F64, ray_rad: float, sign: int, psi_1: YawEstimate | None
) -> YawEstimate | None:
    """Return psi_2, its magnitude by the body's proportions.

    Its sign is by the face, or by psi_1 if the face gives none. Pixels (17x2) are NaN where the
    keypoint does not count; psi_2 counts from `ray_rad`.
    """
    d_sh = torso_height(pixels)
    magnitude_rad = ratio_angle(pixels, d_sh) if d_sh >= TORSO_MIN_PX else None
    if sign == 0 and psi_1 is not None:
        sign = 1 if wrap(psi_1.rad - ray_rad) >= 0 else -1
    if magnitude_rad is None or sign == 0:
        return None
    # The slope of arccos is unbounded at 0 and pi, the error is not.
    slope = 1 / max(math.sin(magnitude_rad), math.sqrt(SIGMA_RATIO))
    return YawEstimate(wrap(sign * magnitude_rad + ray_rad), SIGMA_RATIO * slope)


def torso_height(pixels: F64) -> float:
    """Return d_sh, the height of the shoulders above the hips, in pixels; -inf if unknown."""
    heights = pixels[list(HIPS), 1] - pixels[list(SHOULDERS), 1]
    heights = heights[np.isfinite(heights)]
    return float(heights.mean()) if len(heights) else -math.inf


def ratio_angle(pixels: F64, d_sh: float) -> float | None:
    """Return |psi_2|, the mean of arccos(r_s) and arccos(r_h), from the line of sight, 0 to pi."""
    widths = np.array([pixels[right, 0] - pixels[left, 0] for left, right in (SHOULDERS, HIPS)])
    ratios = widths / d_sh / (SHOULDER_RATIO_MAX, HIP_RATIO_MAX)
    ratios = ratios[np.isfinite(ratios)]
    return float(np.arccos(np.clip(ratios, -1.0, 1.0)).mean()) if len(ratios) else None


def face_sign(keypoints: F32, d_sh: float, rule: FaceRule) -> int:
    """Return the sign of psi_2 by the face; 0 if unknown.

    Visible (eq. 4.17): + if the left eye or ear is visible and the right ear is not, - for the
    opposite. If both eyes but no ear are visible, both conditions hold: 0.
    """
    visible = keypoints[:, 2] > rule.confidence_min
    if rule.by_nose:
        u = keypoints[:, 0].astype(np.float64)
        offset = (u[LEFT_EAR] + u[RIGHT_EAR]) / 2 - u[NOSE]
        clear = visible[[NOSE, LEFT_EAR, RIGHT_EAR]].all()
        return int(np.sign(offset)) if clear and abs(offset) >= NOSE_OFFSET_MIN * d_sh else 0
    left = (visible[LEFT_EYE] or visible[LEFT_EAR]) and not visible[RIGHT_EAR]
    right = (visible[RIGHT_EYE] or visible[RIGHT_EAR]) and not visible[LEFT_EAR]
    return int(left) - int(right)
