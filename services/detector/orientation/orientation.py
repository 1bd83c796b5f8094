"""Which way a person faces, from one RGB-D frame (method book section 6).

Angles are taken in the camera's body frame: x forward along the optical axis, y left, z up. 0 is
facing away along the axis, pi facing the camera, +pi/2 facing image-left. What leaves this module
for the wire is not the angle but its unit vector in the optical frame, because a vector is turned
by any transform, an angle only by one about the same axis. For a level pair of shoulders the
horizontal part of that vector is right at any tilt of the camera, see `heading_vector`.
"""

import math
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL, deproject, wrap
from people4d.messages import F32, F64, U16, CameraInfo
from services.detector.orientation.body_angle import BodyRule, best_angle, doubt, log_likelihood
from services.detector.orientation.body_look import Viewer
from services.detector.position.position import KeypointRule, Sight, keypoint_depth

NOSE, LEFT_EYE, RIGHT_EYE, LEFT_EAR, RIGHT_EAR = 0, 1, 2, 3, 4  # COCO
LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_HIP, RIGHT_HIP = 5, 6, 11, 12
UNSURE_RAD = math.pi / 2  # an angle that is less sure is not told
SHOULDERS, HIPS = (LEFT_SHOULDER, RIGHT_SHOULDER), (LEFT_HIP, RIGHT_HIP)


class FaceRule(msgspec.Struct, frozen=True, kw_only=True):
    """How the face tells the side that a person is turned to; the defaults are the paper's."""

    # "visible": by which eyes and ears are seen (section 6, eq. 4.17). "nose": by the side of the
    # ears' middle that the nose is on, for models that are as sure of hidden points as of seen ones
    # (this project's). "none": not at all, the sign is that of psi_1.
    cue: Literal["visible", "nose", "none"] = "visible"
    confidence_min: float = 0.5  # eyes, ears and nose above are seen, 0 to 1; this project's
    nose_offset_min: float = 0.05  # nose to the ears' middle, of the torso's height; this project's

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0 <= self.confidence_min < 1:
            raise ValueError(f"confidence_min: expected 0 to below 1, got {self.confidence_min}")
        _expect_positive(self, "nose_offset_min")


class OrientationRule(msgspec.Struct, frozen=True, kw_only=True):
    """How the direction of the chest is read from keypoints; each part can be switched off."""

    vector: bool = True  # psi_1, from shoulders or hips in 3D; section 6, eq. 4.12
    ratio: bool = True  # psi_2, from proportions in the image; section 6, eq. 4.13 to 4.16
    ray: bool = True  # psi_2 counts from the line of sight; off: from the axis; section 6
    face: FaceRule | None = None  # sign of psi_2; absent: suits the model
    baseline_min_m: float = 0.1  # [m] a shorter pair hides one of its points; section 6
    shoulder_ratio_max: float = 0.90  # largest shoulder width over torso height; section 6
    hip_ratio_max: float = 0.66  # largest hip width over torso height; section 6
    torso_min_px: float = 8.0  # [px] a lower torso has no readable proportions; this project's
    weighted: bool = False  # psi_1 and psi_2 count by 1 / sigma^2, else equally; section 6: False
    # How sure a measurement is, from the simulated room; this project's.
    sigma_point_m: float = 0.05  # [m] each point of the pair, across the pair
    sigma_ratio: float = 0.18  # ratio over the largest ratio
    # True: in place of psi_1 and psi_2, the angle under which all that is seen is most likely, see
    # `body_angle`; section 6: False
    whole: bool = False
    body: BodyRule = BodyRule()  # of "whole"

    def __post_init__(self) -> None:
        """Check the ranges."""
        _expect_positive(self, "baseline_min_m", "shoulder_ratio_max", "hip_ratio_max")
        _expect_positive(self, "torso_min_px", "sigma_point_m", "sigma_ratio")


def _expect_positive(record: msgspec.Struct, *names: str) -> None:
    for name in names:
        if not 0 < getattr(record, name) < math.inf:
            raise ValueError(f"{name}: expected a number > 0, got {getattr(record, name)}")


@dataclass(frozen=True, slots=True)
class Angle:
    """A measured angle in the camera's body frame."""

    rad: float  # [rad] in (-pi, pi]
    sigma_rad: float  # [rad] standard deviation


@dataclass(frozen=True, slots=True)
class Orientation:
    """What one frame tells of the way a person faces; None is what it does not tell."""

    vector: Angle | None  # psi_1
    ratio: Angle | None  # psi_2, the bearing added

    def fused(self, weighted: bool = False) -> Angle | None:
        """Return the circular mean of what was measured (eq. 4.18); None of opposite angles.

        Args:
            weighted: Each angle counts by 1 / sigma^2; else equally.
        """
        psi = [angle for angle in (self.vector, self.ratio) if angle is not None]
        weights = [angle.sigma_rad**-2 if weighted else 1.0 for angle in psi]
        sines = sum(w * math.sin(a.rad) for w, a in zip(weights, psi, strict=True))
        cosines = sum(w * math.cos(a.rad) for w, a in zip(weights, psi, strict=True))
        if math.hypot(sines, cosines) <= 1e-6 * sum(weights):
            return None
        parts = [w * a.sigma_rad for w, a in zip(weights, psi, strict=True)]
        sigma_rad = math.hypot(*parts) / sum(weights)
        if len(psi) == 2:  # two that differ by more than their sigmas explain are less sure
            apart_rad = abs(wrap(psi[0].rad - psi[1].rad))
            sigma_rad *= max(1.0, apart_rad / math.hypot(*(a.sigma_rad for a in psi)))
        return Angle(wrap(math.atan2(sines, cosines)), sigma_rad)


def orientation(
    keypoints: F32, depth_mm: U16, info: CameraInfo, rule: OrientationRule, reading: KeypointRule
) -> Orientation:
    """Measure which way a person faces.

    Args:
        keypoints: 17x3, u and v in pixels and confidence, COCO order.
        depth_mm: Depth image, 0 = no reading.
        info: Calibration.
        rule: The parts and constants of the method.
        reading: Which keypoints count, and how their depth is read.

    Source:
        Method book section 6.
    """
    psi_1 = psi_2 = None
    if rule.vector:
        depth_m = keypoint_depth(keypoints, depth_mm, info, reading)
        points = deproject(keypoints[:, :2], depth_m, info) @ LINK_FROM_OPTICAL[:3, :3].T
        psi_1 = vector_yaw(points, rule)
    if rule.ratio:
        confident = keypoints[:, 2:] > reading.confidence_min
        pixels = np.where(confident, keypoints[:, :2].astype(np.float64), np.nan)
        ray_rad = bearing(pixels, info) if rule.ray else 0.0
        psi_2 = ratio_yaw(keypoints, pixels, ray_rad, psi_1, rule)
    return Orientation(psi_1, psi_2)


def whole_body(
    keypoints: F32, layer_m: float, sight: Sight, rule: OrientationRule, confidence_min: float
) -> Angle | None:
    """Measure which way a person faces, by all that is seen at once.

    Args:
        keypoints: 17x3, u and v in pixels and confidence, COCO order.
        layer_m: Depth of the layer that the person is in.
        sight: What the camera sees.
        rule: How bodies look.
        confidence_min: Keypoints must be more confident than this, 0 to 1.
    """
    body = rule.body
    confident = keypoints[:, 2:] > confidence_min
    pixels = np.where(confident, keypoints[:, :2].astype(np.float64), np.nan)
    ray_rad = bearing(pixels, sight.info)
    viewer = Viewer({"shoulders": body.shoulders, "hips": body.hips}, confidence_min, body.reach_m)
    seen = viewer.look(keypoints, layer_m, ray_rad, sight)
    found = best_angle(log_likelihood(seen, sight.info.fx, body))
    if found is None:
        return None
    sigma_rad = found[1] * doubt(seen, body)
    return Angle(wrap(found[0] + ray_rad), sigma_rad) if sigma_rad < UNSURE_RAD else None


def vector_yaw(points_m: F64, rule: OrientationRule) -> Angle | None:
    """Return psi_1 = atan2(d_x, -d_y), d = p_right - p_left of the shoulders, else of the hips.

    Args:
        points_m: 17x3 keypoints in metres, body frame of the camera, NaN where unknown.
        rule: A shorter d than its baseline is refused: one point hides the other.
    """
    pairs = (points_m[right] - points_m[left] for left, right in (SHOULDERS, HIPS))
    d = next((pair for pair in pairs if np.isfinite(pair).all()), np.zeros(3))
    level_m = math.hypot(d[0], d[1])
    if np.linalg.norm(d) < rule.baseline_min_m or level_m == 0:
        return None
    sigma_rad = min(math.sqrt(2) * rule.sigma_point_m / level_m, math.pi)
    return Angle(wrap(math.atan2(d[0], -d[1])), sigma_rad)


def ratio_yaw(
    keypoints: F32, pixels: F64, ray_rad: float, psi_1: Angle | None, rule: OrientationRule
) -> Angle | None:
    """Return psi_2, its magnitude by the body's proportions and its sign by the face or psi_1.

    Args:
        keypoints: 17x3, u and v in pixels and confidence.
        pixels: 17x2, u and v, NaN where the keypoint does not count.
        ray_rad: Direction from which psi_2 counts.
        psi_1: The other estimate.
        rule: The constants of the method.
    """
    d_sh = torso_height(pixels)
    magnitude_rad = ratio_angle(pixels, d_sh, rule) if d_sh >= rule.torso_min_px else None
    if magnitude_rad is None:
        return None
    sign = face_sign(keypoints, d_sh, rule.face or FaceRule())
    if sign == 0 and psi_1 is not None:
        sign = 1 if wrap(psi_1.rad - ray_rad) >= 0 else -1
    if sign == 0:
        return None
    # The slope of arccos grows without limit at 0 and pi, the error does not.
    slope = 1 / max(math.sin(magnitude_rad), math.sqrt(rule.sigma_ratio))
    return Angle(wrap(sign * magnitude_rad + ray_rad), rule.sigma_ratio * slope)


def torso_height(pixels: F64) -> float:
    """Return d_sh, how far the hips are below their shoulders, in pixels; -inf if unknown.

    Args:
        pixels: 17x2, u and v, NaN where unknown.
    """
    heights = pixels[list(HIPS), 1] - pixels[list(SHOULDERS), 1]
    heights = heights[np.isfinite(heights)]
    return float(heights.mean()) if len(heights) else -math.inf


def ratio_angle(pixels: F64, d_sh: float, rule: OrientationRule) -> float | None:
    """Return |psi_2|, the mean of arccos(r_s) and arccos(r_h), from the line of sight, 0 to pi.

    Args:
        pixels: 17x2, u and v, NaN where unknown.
        d_sh: Height of the torso in pixels.
        rule: The largest ratios of the human body.
    """
    widths = np.array([pixels[right, 0] - pixels[left, 0] for left, right in (SHOULDERS, HIPS)])
    ratios = widths / d_sh / (rule.shoulder_ratio_max, rule.hip_ratio_max)
    ratios = ratios[np.isfinite(ratios)]
    return float(np.arccos(np.clip(ratios, -1.0, 1.0)).mean()) if len(ratios) else None


def face_sign(keypoints: F32, d_sh: float, rule: FaceRule) -> int:
    """Return the sign of psi_2 by the face; 0 where it does not tell.

    Visible (eq. 4.17): + if the left eye or ear is seen and the right ear is not, - for the
    opposite. Both eyes without any ear fulfil both, which tells nothing.

    Args:
        keypoints: 17x3, u and v in pixels and confidence.
        d_sh: Height of the torso in pixels.
        rule: The cue and its constants.
    """
    seen = keypoints[:, 2] > rule.confidence_min
    if rule.cue == "visible":
        left = (seen[LEFT_EYE] or seen[LEFT_EAR]) and not seen[RIGHT_EAR]
        right = (seen[RIGHT_EYE] or seen[RIGHT_EAR]) and not seen[LEFT_EAR]
        return int(left) - int(right)
    if rule.cue == "nose" and seen[[NOSE, LEFT_EAR, RIGHT_EAR]].all():
        u = keypoints[:, 0].astype(np.float64)
        offset = (u[LEFT_EAR] + u[RIGHT_EAR]) / 2 - u[NOSE]
        return int(np.sign(offset)) if abs(offset) >= rule.nose_offset_min * d_sh else 0
    return 0


def bearing(pixels: F64, info: CameraInfo) -> float:
    """Return the direction of the line of sight to the torso, 0 = optical axis, + to the left.

    Args:
        pixels: 17x2, u and v, NaN where unknown.
        info: Calibration.
    """
    torso = pixels[[*SHOULDERS, *HIPS]]
    torso = torso[np.isfinite(torso[:, 0])]
    if not len(torso):
        return 0.0
    x, _, z = deproject(torso.mean(axis=0), [1.0], info)[0]
    return math.atan2(-x, z)


def heading_vector(yaw_rad: float) -> F64:
    """Return the unit vector (3, optical frame) of an angle in the camera's body frame.

    It is d turned about the camera's upward axis. If d is level, then the horizontal part of that
    vector has the direction of the person at any tilt and roll of the camera: the part that the
    tilt adds is vertical. psi_2 knows no tilt: from 20 deg above, the torso looks 6 % shorter,
    which costs about 2 deg in general and up to 20 deg near 0 and pi, where arccos is steep.
    """
    return np.array([-math.sin(yaw_rad), 0.0, math.cos(yaw_rad)])
