"""Observation of bodies from one frame, for the joint likelihood of their yaws.

Offsets are relative to the line of sight to the torso: across to the right, and along it.
"""

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
    bearings,
    confident_pixels,
)
from services.detector.position.surface import DepthImage, DepthWindows
from services.detector.position.visible_area import in_image

# Minimum confidence of a keypoint, lower than for positions: keypoints of low confidence are mostly
# correct, and raise the uncertainty of the yaw
CONFIDENCE_MIN = 0.1
WINDOW_MIN_PX = 5  # minimum side of a joint's window [px]
WINDOWS_M = (0.1, 0.1, 0.2, 0.2)  # sides of the windows of shoulders and hips [m]
REACH_M = 0.35  # maximum distance of a reading from the person's layer [m]
VISIBLE_MIN = 0.2  # minimum share of a visible joint's window in the person's own layer
JOINTS = {"shoulders": SHOULDERS, "hips": HIPS}


@dataclass(frozen=True, slots=True)
class JointOffsets:
    """Positions of the right joints of a pair from the left ones, of N people; NaN if unknown."""

    across_m: F64  # [m] N, to the right
    along_m: F64  # [m] N, farther from the camera


@dataclass(frozen=True, slots=True)
class YawObservations:
    """Measurements of N people."""

    z_m: F64  # [m] N, depth of the person
    pairs: Mapping[str, JointOffsets]  # "shoulders" and "hips"
    nose_m: F64  # [m] N, nose to the left of the ears' middle; NaN if unknown
    ears_m: F64  # [m] N, right ear to the right of the left one; NaN if unknown
    side: F64  # N, mean confidence of the keypoints of the less confident side
    ray_rad: F64  # [rad] N, direction of the line of sight, 0 = optical axis, + to the left


def observe_bodies(keypoints: F32, layers_m: F64, image: DepthImage) -> YawObservations:
    """Measure the bodies of N people, each in a layer of depth.

    Keypoints are Nx17x3, u and v in pixels and confidence; layers N in metres.
    """
    pixels = confident_pixels(keypoints, CONFIDENCE_MIN)
    rays_rad = bearings(pixels, image.info)
    points_m = deproject(pixels.reshape(-1, 2), np.repeat(layers_m, 17), image.info)
    across_m = points_m[:, 0].reshape(-1, 17) * np.cos(rays_rad)[:, None]
    depths_m = _joint_depths(pixels, layers_m, image)
    pairs = {}
    for k, (name, (left, right)) in enumerate(JOINTS.items()):
        deep_m = depths_m[:, 2 * k + 1] - depths_m[:, 2 * k]
        # Positions of hidden joints are guesses.
        wide_m = np.where(np.isnan(deep_m), np.nan, across_m[:, right] - across_m[:, left])
        pairs[name] = JointOffsets(wide_m, deep_m / np.cos(rays_rad) - wide_m * np.tan(rays_rad))
    left_m, right_m = across_m[:, LEFT_EAR], across_m[:, RIGHT_EAR]
    confidence = keypoints[:, 1:, 2].astype(np.float64).reshape(-1, 8, 2)  # COCO: left, right
    return YawObservations(
        z_m=layers_m,
        pairs=pairs,
        nose_m=(left_m + right_m) / 2 - across_m[:, NOSE],
        ears_m=right_m - left_m,
        side=confidence.mean(axis=1).min(axis=1),
        ray_rad=rays_rad,
    )


def _joint_depths(pixels: F64, layers_m: F64, image: DepthImage) -> F64:
    """Return the depths at shoulders and hips, Nx4 in metres; NaN if others fill the window."""
    half_px = np.rint(np.array(WINDOWS_M) / 2 * image.info.fx / layers_m[:, None]).astype(int)
    sides_px = 2 * np.maximum(half_px, WINDOW_MIN_PX // 2) + 1
    joints_px = pixels[:, [*SHOULDERS, *HIPS]].reshape(-1, 2)
    inside = in_image(joints_px, image.info)
    middle_m = np.repeat(layers_m, 4)
    windows = DepthWindows(np.where(inside[:, None], joints_px, 0.0), image, sides_px.ravel())
    depths_m, found = windows.medians(middle_m - REACH_M, middle_m + REACH_M)
    depths_m[~inside | (found < VISIBLE_MIN * windows.sizes())] = np.nan
    return depths_m.reshape(-1, 4)
