"""Yaw by two separate estimates from keypoints (docs/method.md section 6 [PIC4SeR]).

psi_1 is from shoulders or hips in 3D, psi_2 from the proportions of the body in the image.
"""

import math
from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL, deproject, wrap
from people4d.messages import F32, F64
from services.detector.config import KeypointConfig
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
from services.detector.orientation.config import FaceConfig, OrientationConfig
from services.detector.position.surface import DepthImage, keypoint_depth


@dataclass(frozen=True, slots=True)
class YawPair:
    """Both estimates of one person; None without one."""

    vector: YawEstimate | None  # psi_1
    ratio: YawEstimate | None  # psi_2, the bearing added

    def fuse(self, weighted: bool = False) -> YawEstimate | None:
        """Return the circular mean (eq. 4.18), weighted by 1 / sigma^2 if so chosen."""
        psi = [angle for angle in (self.vector, self.ratio) if angle is not None]
        weights = [angle.sigma_rad**-2 if weighted else 1.0 for angle in psi]
        pairs = list(zip(weights, psi, strict=True))
        sines = sum(weight * math.sin(angle.rad) for weight, angle in pairs)
        cosines = sum(weight * math.cos(angle.rad) for weight, angle in pairs)
        if math.hypot(sines, cosines) <= 1e-6 * sum(weights):
            return None
        sigma_rad = math.hypot(*(w * angle.sigma_rad for w, angle in pairs)) / sum(weights)
        if len(psi) == 2:  # that differ by more than their sigmas explain
            apart_rad = abs(wrap(psi[0].rad - psi[1].rad))
            sigma_rad *= max(1.0, apart_rad / math.hypot(*(a.sigma_rad for a in psi)))
        return YawEstimate(wrap(math.atan2(sines, cosines)), sigma_rad)


def separate_yaws(
    keypoints: F32, image: DepthImage, config: OrientationConfig, used: KeypointConfig
) -> YawPair:
    """Estimate the yaw of a person by two methods.

    Keypoints are 17x3, u and v in pixels and confidence, COCO order; `used` are those that count.
    """
    psi_1 = psi_2 = None
    if config.vector:
        depth_m = keypoint_depth(keypoints, image, used)
        points = deproject(keypoints[:, :2], depth_m, image.info) @ LINK_FROM_OPTICAL[:3, :3].T
        psi_1 = vector_yaw(points, config)
    if config.ratio:
        pixels = confident_pixels(keypoints, used.confidence_min)
        ray_rad = float(bearings(pixels[None], image.info)[0]) if config.ray else 0.0
        psi_2 = ratio_yaw(keypoints, pixels, ray_rad, psi_1, config)
    return YawPair(psi_1, psi_2)


def vector_yaw(points_m: F64, config: OrientationConfig) -> YawEstimate | None:
    """Return psi_1 = atan2(d_x, -d_y), d = p_right - p_left of the shoulders, else of the hips.

    A d shorter than the baseline is refused: one point hides the other. Keypoints are 17x3 in
    metres, body frame of the camera, NaN where unknown.
    """
    pairs = (points_m[right] - points_m[left] for left, right in (SHOULDERS, HIPS))
    d = next((pair for pair in pairs if np.isfinite(pair).all()), np.zeros(3))
    level_m = math.hypot(d[0], d[1])
    if np.linalg.norm(d) < config.baseline_min_m or level_m == 0:
        return None
    sigma_rad = min(math.sqrt(2) * config.sigma_point_m / level_m, math.pi)
    return YawEstimate(wrap(math.atan2(d[0], -d[1])), sigma_rad)


def ratio_yaw(
    keypoints: F32,
    pixels: F64,
    ray_rad: float,
    psi_1: YawEstimate | None,
    config: OrientationConfig,
) -> YawEstimate | None:
    """Return psi_2, its magnitude by the body's proportions and its sign by the face or psi_1.

    Pixels (17x2) are NaN where the keypoint does not count; psi_2 counts from `ray_rad`.
    """
    d_sh = torso_height(pixels)
    magnitude_rad = ratio_angle(pixels, d_sh, config) if d_sh >= config.torso_min_px else None
    if magnitude_rad is None:
        return None
    sign = face_sign(keypoints, d_sh, config.face or FaceConfig())
    if sign == 0 and psi_1 is not None:
        sign = 1 if wrap(psi_1.rad - ray_rad) >= 0 else -1
    if sign == 0:
        return None
    # The slope of arccos grows without limit at 0 and pi, the error does not.
    slope = 1 / max(math.sin(magnitude_rad), math.sqrt(config.sigma_ratio))
    return YawEstimate(wrap(sign * magnitude_rad + ray_rad), config.sigma_ratio * slope)


def torso_height(pixels: F64) -> float:
    """Return d_sh, the height of the shoulders above the hips, in pixels; -inf if unknown."""
    heights = pixels[list(HIPS), 1] - pixels[list(SHOULDERS), 1]
    heights = heights[np.isfinite(heights)]
    return float(heights.mean()) if len(heights) else -math.inf


def ratio_angle(pixels: F64, d_sh: float, config: OrientationConfig) -> float | None:
    """Return |psi_2|, the mean of arccos(r_s) and arccos(r_h), from the line of sight, 0 to pi."""
    widths = np.array([pixels[right, 0] - pixels[left, 0] for left, right in (SHOULDERS, HIPS)])
    ratios = widths / d_sh / (config.shoulder_ratio_max, config.hip_ratio_max)
    ratios = ratios[np.isfinite(ratios)]
    return float(np.arccos(np.clip(ratios, -1.0, 1.0)).mean()) if len(ratios) else None


def face_sign(keypoints: F32, d_sh: float, config: FaceConfig) -> int:
    """Return the sign of psi_2 by the face; 0 if unknown.

    Visible (eq. 4.17): + if the left eye or ear is visible and the right ear is not, - for the
    opposite. Both eyes without any ear fulfil both and give 0.
    """
    visible = keypoints[:, 2] > config.confidence_min
    if config.cue == "visible":
        left = (visible[LEFT_EYE] or visible[LEFT_EAR]) and not visible[RIGHT_EAR]
        right = (visible[RIGHT_EYE] or visible[RIGHT_EAR]) and not visible[LEFT_EAR]
        return int(left) - int(right)
    if config.cue == "nose" and visible[[NOSE, LEFT_EAR, RIGHT_EAR]].all():
        u = keypoints[:, 0].astype(np.float64)
        offset = (u[LEFT_EAR] + u[RIGHT_EAR]) / 2 - u[NOSE]
        return int(np.sign(offset)) if abs(offset) >= config.nose_offset_min * d_sh else 0
    return 0
