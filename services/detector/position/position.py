"""Where a person is, from one depth image (method book section 2).

A reading is valid when it is above 0 and not beyond the camera's max_depth_m. Positions read here
lie on the surface that faces the camera: about half a body's depth in front of the person's axis,
see `trunk`.
"""

import math
from dataclasses import dataclass

import cv2
import msgspec
import numpy as np
import numpy.typing as npt

from common.geometry.transforms import deproject
from people4d.messages import F32, F64, U16, CameraInfo
from services.detector.models.base import InstanceMask

TORSO = [5, 6, 11, 12]  # COCO: shoulders and hips


class KeypointRule(msgspec.Struct, frozen=True, kw_only=True):
    """Which keypoints make a position; the defaults are the paper's."""

    confidence_min: float = 0.6  # keypoints must be more confident than this, 0 to 1
    window_px: int = 1  # [px] odd side of the window whose median depth is read; 1: one pixel
    torso_gap_max_m: float = math.inf  # [m] readings farther from the torso's depth do not count

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0 <= self.confidence_min < 1:
            raise ValueError(f"confidence_min: expected 0 to below 1, got {self.confidence_min}")
        if self.window_px % 2 == 0 or not 1 <= self.window_px <= 31:
            raise ValueError(f"window_px: expected an odd number, 1 to 31, got {self.window_px}")
        if not self.torso_gap_max_m > 0:
            raise ValueError(f"torso_gap_max_m: expected > 0, got {self.torso_gap_max_m}")


@dataclass(frozen=True, slots=True)
class Sight:
    """What a person's position is read from."""

    depth_mm: U16  # depth image, 0 = no reading
    info: CameraInfo  # calibration
    yaw_rad: float | None = None  # way faced in the camera's body frame; None if unknown


@dataclass(frozen=True, slots=True)
class Place:
    """Where a person is."""

    position_m: F64  # [m] 3, optical frame
    covariance_m2: F64 | None = None  # [m^2] 3x3, optical frame; None if it is not told


def mask_centroid(mask: InstanceMask, depth_mm: U16, info: CameraInfo) -> F64 | None:
    """Return the point seen at the centroid of a mask.

    Args:
        mask: Pixels of the person.
        depth_mm: Depth image, 0 = no reading.
        info: Calibration.

    Returns:
        3 in metres, optical frame; None if the centroid lies outside of the mask (a bent body) or
        on a pixel without a valid reading.

    Source:
        Method book section 2, segmentation methods.
    """
    moments = cv2.moments(mask.window, binaryImage=True)
    if moments["m00"] == 0:
        return None
    centroid = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
    column, row = np.rint(centroid).astype(int)
    if not mask.window[row, column]:
        return None
    pixel = centroid + np.array([mask.x_px, mask.y_px])
    depth_m = read_depth(pixel[None], depth_mm, info.max_depth_m)
    return None if np.isnan(depth_m[0]) else deproject(pixel, depth_m, info)[0]


def keypoint_mean(
    keypoints: F32, depth_mm: U16, info: CameraInfo, rule: KeypointRule
) -> F64 | None:
    """Return the mean of the points seen at the confident keypoints.

    Args:
        keypoints: 17x3, u and v in pixels and confidence, COCO order.
        depth_mm: Depth image, 0 = no reading.
        info: Calibration.
        rule: Which keypoints count.

    Returns:
        3 in metres, optical frame; None if no keypoint is both confident and validly read.

    Source:
        Method book section 2, pose method.
    """
    depth_m = keypoint_depth(keypoints, depth_mm, info, rule)
    used = np.isfinite(depth_m)
    if not used.any():
        return None
    mean: F64 = deproject(keypoints[used, :2], depth_m[used], info).mean(axis=0)
    return mean


def keypoint_depth(keypoints: F32, depth_mm: U16, info: CameraInfo, rule: KeypointRule) -> F64:
    """Return the depth read at each keypoint: 17 in metres, NaN where the rule refuses it."""
    depth_m = read_depth(
        keypoints[:, :2].astype(np.float64), depth_mm, info.max_depth_m, rule.window_px
    )
    used = (keypoints[:, 2] > rule.confidence_min) & np.isfinite(depth_m)
    if used.any():
        used &= np.abs(depth_m - _torso_depth(depth_m, used)) <= rule.torso_gap_max_m
    return np.where(used, depth_m, np.nan)


def read_depth(pixels: F64, depth_mm: U16, max_depth_m: float, window_px: int = 1) -> F64:
    """Read the depth at pixels: the median of the valid readings around each.

    Args:
        pixels: Nx2, u and v; rounded to the nearest pixel.
        depth_mm: Depth image, 0 = no reading.
        max_depth_m: Readings beyond are invalid.
        window_px: Odd side of the window; what reaches beyond the image is left out.

    Returns:
        N in metres, NaN where there is no valid reading.
    """
    height, width = depth_mm.shape
    reach = np.arange(window_px) - window_px // 2
    # Far outside is outside: a wild coordinate must not overflow the integer.
    u, v = np.rint(np.clip(pixels, -window_px - 1, max(height, width) + window_px)).astype(int).T
    columns, rows = u[:, None, None] + reach, v[:, None, None] + reach[:, None]
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    readings_m = depth_mm[rows.clip(0, height - 1), columns.clip(0, width - 1)] / 1000.0
    readings_m[~inside | (readings_m == 0) | (readings_m > max_depth_m)] = np.nan
    readings_m = readings_m.reshape(len(pixels), window_px**2)
    readings_m.sort(axis=1)  # NaN comes last
    count, row = np.isfinite(readings_m).sum(axis=1), np.arange(len(pixels))
    median_m: F64 = (readings_m[row, (count - 1) // 2] + readings_m[row, count // 2]) / 2
    median_m[count == 0] = np.nan
    return median_m


def _torso_depth(depth_m: F64, used: npt.NDArray[np.bool_]) -> float:
    """Return the median depth of the torso's keypoints, of all used ones if none is seen."""
    torso_m = depth_m[TORSO][used[TORSO]]
    ranked_m = np.sort(torso_m if len(torso_m) else depth_m[used])
    # As np.median, which takes ten times as long for so few.
    middle = len(ranked_m) - 1
    return float((ranked_m[middle // 2] + ranked_m[(middle + 1) // 2]) / 2)
