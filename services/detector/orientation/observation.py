"""Observation of bodies from one frame, for the joint likelihood of their yaws."""

from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F32, F64
from services.detector.orientation.angle import (
    LEFT_EAR,
    LEFT_SHOULDER,
    NOSE,
    RIGHT_EAR,
    RIGHT_SHOULDER,
    SHOULDERS,
    bearings,
    confident_pixels,
)
from services.detector.position.surface import DepthImage, DepthWindows, Flags
from services.detector.position.visible_area import in_image

# Minimum confidence of a keypoint, lower than for positions: keypoints of low confidence are mostly
# correct, and raise the uncertainty of the yaw
CONFIDENCE_MIN = 0.1
WINDOW_MIN_PX = 5  # minimum side of a shoulder's window [px]
WINDOW_M = 0.1  # side of a shoulder's window [m]
REACH_M = 0.35  # maximum distance of a reading from the person's layer [m]
VISIBLE_MIN = 0.2  # minimum share of a visible shoulder's window in the person's own layer


@dataclass(frozen=True, slots=True)
class YawObservations:
    """Measurements of N people."""

    z_m: F64  # [m] N, depth of the person
    # [m] N, right shoulder to the right of the left one, across the line of sight; NaN if unknown
    shoulders_m: F64
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
    # Positions of hidden joints are guesses.
    visible = _visible(pixels[:, SHOULDERS], layers_m, image).all(axis=1)
    shoulders_m = across_m[:, RIGHT_SHOULDER] - across_m[:, LEFT_SHOULDER]
    left_m, right_m = across_m[:, LEFT_EAR], across_m[:, RIGHT_EAR]
    confidence = keypoints[:, 1:, 2].astype(np.float64).reshape(-1, 8, 2)  # COCO: left, right
    return YawObservations(
        z_m=layers_m,
        shoulders_m=np.where(visible, shoulders_m, np.nan),
        nose_m=(left_m + right_m) / 2 - across_m[:, NOSE],
        ears_m=right_m - left_m,
        side=confidence.mean(axis=1).min(axis=1),
        ray_rad=rays_rad,
    )


def _visible(pixels: F64, layers_m: F64, image: DepthImage) -> Flags:
    """Return flags of joints (Nx2x2 pixels) whose window shows enough of the own layer, Nx2."""
    half_px = np.rint(WINDOW_M / 2 * image.info.fx / layers_m).astype(int)
    side_px = 2 * np.maximum(half_px, WINDOW_MIN_PX // 2) + 1
    joints_px, middle_m = pixels.reshape(-1, 2), np.repeat(layers_m, 2)
    inside = in_image(joints_px, image.info)
    joints_px = np.where(inside[:, None], joints_px, 0.0)
    windows = DepthWindows(joints_px, image, np.repeat(side_px, 2))
    _, found = windows.medians(middle_m - REACH_M, middle_m + REACH_M)
    flags: Flags = (inside & (found >= VISIBLE_MIN * windows.sizes())).reshape(-1, 2)
    return flags
