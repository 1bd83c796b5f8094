"""Observation of a body from one frame, for the joint likelihood of its yaw.

Everything is measured from the line of sight to the torso: across it to the right, and along it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F32, F64
from services.detector.orientation.angle import (
    HIPS,
    LEFT_EAR,
    NOSE,
    RIGHT_EAR,
    SHOULDERS,
    bearing,
    confident_pixels,
)
from services.detector.orientation.config import BodyModelConfig
from services.detector.position.surface import DepthImage

FACE = [0, 1, 2, 3, 4]  # COCO
SIDES = [[1, 3, 5, 7, 9, 11, 13, 15], [2, 4, 6, 8, 10, 12, 14, 16]]  # left, right
WINDOW_MIN_PX = 5
VISIBLE_MIN = 0.2  # of a joint's window in the person's own layer: else others hide the joint
JOINTS = {"shoulders": SHOULDERS, "hips": HIPS}


@dataclass(frozen=True, slots=True)
class JointOffset:
    """Position of the right joint of a pair from the left one; NaN if unknown."""

    across_m: float  # [m] to the right
    along_m: float  # [m] farther from the camera


@dataclass(frozen=True, slots=True)
class YawObservation:
    """Measurements of one person."""

    z_m: float  # [m] depth of the person
    pairs: Mapping[str, JointOffset]  # "shoulders" and "hips"
    nose_m: float  # [m] nose to the left of the ears' middle; NaN if unknown
    ears_m: float  # [m] right ear to the right of the left one; NaN if unknown
    face: float = math.nan  # mean confidence of nose, eyes and ears
    side: float = math.nan  # mean confidence of the keypoints of the less confident side
    ray_rad: float = 0.0  # [rad] direction of the line of sight, 0 = optical axis, + to the left


def observe_body(
    keypoints: F32,
    layer_m: float,
    image: DepthImage,
    confidence_min: float,
    config: BodyModelConfig,
) -> YawObservation:
    """Measure the body of a person in a layer of depth.

    Keypoints are 17x3, u and v in pixels and confidence, which must be more than `confidence_min`.
    """
    pixels = confident_pixels(keypoints, confidence_min)
    ray_rad = bearing(pixels, image.info)
    across_m = deproject(pixels, np.full(17, layer_m), image.info)[:, 0] * math.cos(ray_rad)
    windows_m = {"shoulders": config.shoulders.window_m, "hips": config.hips.window_m}
    pairs = {}
    for name, (left, right) in JOINTS.items():
        half_px = windows_m[name] / 2 * image.info.fx / layer_m
        reach_px = max(round(half_px), WINDOW_MIN_PX // 2)
        depth_m = [
            _joint_depth(pixels[joint], reach_px, layer_m, config.reach_m, image)
            for joint in (left, right)
        ]
        wide_m, deep_m = across_m[right] - across_m[left], depth_m[1] - depth_m[0]
        if math.isnan(deep_m):
            wide_m = math.nan  # the position of a hidden joint is a guess
        along_m = deep_m / math.cos(ray_rad) - wide_m * math.tan(ray_rad)
        pairs[name] = JointOffset(wide_m, along_m)
    ears_m, confidence = across_m[[LEFT_EAR, RIGHT_EAR]], keypoints[:, 2].astype(np.float64)
    return YawObservation(
        z_m=layer_m,
        pairs=pairs,
        nose_m=float(ears_m.mean() - across_m[NOSE]),
        ears_m=float(ears_m[1] - ears_m[0]),
        face=float(confidence[FACE].mean()),
        side=min(float(confidence[side].mean()) for side in SIDES),
        ray_rad=ray_rad,
    )


def _joint_depth(
    pixel: F64, reach_px: int, layer_m: float, reach_m: float, image: DepthImage
) -> float:
    """Return the depth in the window of a joint, NaN where the person hardly fills it."""
    height, width = image.depth_mm.shape
    if not ((pixel > -0.5) & (pixel < (width - 0.5, height - 0.5))).all():
        return math.nan  # NaN pixels too
    u, v = np.rint(pixel).astype(int).tolist()
    rows = slice(max(v - reach_px, 0), v + reach_px + 1)
    window_m = image.depth_mm[rows, max(u - reach_px, 0) : u + reach_px + 1] / 1000.0
    own_m = window_m[np.abs(window_m - layer_m) <= reach_m]
    if own_m.size < VISIBLE_MIN * window_m.size:
        return math.nan
    own_m.sort()
    # As np.median, which takes several times as long for so few.
    return float((own_m[(own_m.size - 1) // 2] + own_m[own_m.size // 2]) / 2)
