"""Positions on the surface that faces the camera (docs/method.md section 2).

A reading is valid when it is above 0 and not beyond the camera's max_depth_m.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from common.geometry.transforms import deproject
from people4d.messages import F32, F64, U16, CameraInfo
from services.detector.config import KeypointConfig
from services.detector.models.base import DetectedPerson, InstanceMask

TORSO = [5, 6, 11, 12]  # COCO: shoulders and hips
SURFACE_WINDOW_PX = 5


@dataclass(frozen=True, slots=True)
class DepthImage:
    """Depth image of a calibrated camera."""

    depth_mm: U16  # HxW, 0 = no reading
    info: CameraInfo


@dataclass(frozen=True, slots=True)
class PositionEstimate:
    """Position of a person."""

    position_m: F64  # [m] 3, optical frame
    covariance_m2: F64 | None = None  # [m^2] 3x3, optical frame; None if it is not estimated


def mask_centroid(mask: InstanceMask, image: DepthImage) -> F64 | None:
    """Return the surface point at the centroid of a mask: 3 in metres, optical frame.

    None if that lies outside of the mask (a bent body) or on a pixel without a valid reading.
    Source: docs/method.md section 2, mask [PIC4SeR].
    """
    moments = cv2.moments(mask.window, binaryImage=True)
    if moments["m00"] == 0:
        return None
    centroid = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
    column, row = np.rint(centroid).astype(int)
    if not mask.window[row, column]:
        return None
    pixel = centroid + np.array([mask.x_px, mask.y_px])
    depth_m = read_depth(pixel[None], image)
    return None if np.isnan(depth_m[0]) else deproject(pixel, depth_m, image.info)[0]


def keypoint_mean(keypoints: F32, image: DepthImage, config: KeypointConfig) -> F64 | None:
    """Return the mean of the surface points at the confident keypoints: 3 in metres, optical frame.

    None if no keypoint (17x3, u and v in pixels, confidence) is both confident and validly read.
    Source: docs/method.md section 2, keypoints [PIC4SeR].
    """
    depth_m = keypoint_depth(keypoints, image, config)
    used = np.isfinite(depth_m)
    if not used.any():
        return None
    mean: F64 = deproject(keypoints[used, :2], depth_m[used], image.info).mean(axis=0)
    return mean


def keypoint_depth(keypoints: F32, image: DepthImage, config: KeypointConfig) -> F64:
    """Return the depth at each keypoint: 17 in metres, NaN where it is not used."""
    depth_m = read_depth(keypoints[:, :2].astype(np.float64), image, config.window_px)
    used = (keypoints[:, 2] > config.confidence_min) & np.isfinite(depth_m)
    if used.any():
        used &= np.abs(depth_m - _torso_depth(depth_m, used)) <= config.torso_gap_max_m
    return np.where(used, depth_m, np.nan)


def read_depth(
    pixels: F64, image: DepthImage, window_px: int = 1, max_depth_m: float | None = None
) -> F64:
    """Return the median of the valid readings around pixels (Nx2), N in metres, NaN if none.

    Args:
        pixels: u and v, rounded to the nearest pixel.
        image: The depth.
        window_px: Odd side of the window; its part beyond the image is left out.
        max_depth_m: Readings beyond are invalid; None: as the calibration states.
    """
    depth_mm = image.depth_mm
    furthest_m = image.info.max_depth_m if max_depth_m is None else max_depth_m
    height, width = depth_mm.shape
    reach = np.arange(window_px) - window_px // 2
    # Far outside is outside: a wild coordinate must not overflow the integer.
    u, v = np.rint(np.clip(pixels, -window_px - 1, max(height, width) + window_px)).astype(int).T
    columns, rows = u[:, None, None] + reach, v[:, None, None] + reach[:, None]
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    # As clip, which takes three times as long for so few.
    rows, columns = (
        np.minimum(np.maximum(index, 0), side - 1)
        for index, side in ((rows, height), (columns, width))
    )
    readings_m = depth_mm[rows, columns] / 1000.0
    readings_m[~inside | (readings_m == 0) | (readings_m > furthest_m)] = np.nan
    readings_m = readings_m.reshape(len(pixels), window_px**2)
    readings_m.sort(axis=1)  # NaN comes last
    count, row = np.isfinite(readings_m).sum(axis=1), np.arange(len(pixels))
    median_m: F64 = (readings_m[row, (count - 1) // 2] + readings_m[row, count // 2]) / 2
    median_m[count == 0] = np.nan
    return median_m


def keypoint_surfaces(people: Sequence[DetectedPerson], image: DepthImage) -> list[F32 | None]:
    """Return the depth of the surface at every keypoint of people: 17 in metres each, 0 if unread.

    Whatever is there counts, also somebody in front. None without keypoints.
    """
    pixels = [p.keypoints[:, :2] for p in people if p.keypoints is not None]
    if not pixels:
        return [None] * len(people)
    depth_m = read_depth(np.concatenate(pixels).astype(np.float64), image, SURFACE_WINDOW_PX)
    rows = iter(np.nan_to_num(depth_m).astype(np.float32).reshape(-1, 17))
    return [None if person.keypoints is None else next(rows) for person in people]


def _torso_depth(depth_m: F64, used: npt.NDArray[np.bool_]) -> float:
    """Return the median depth of the torso's keypoints, without them of all used ones."""
    torso_m = depth_m[TORSO][used[TORSO]]
    ranked_m = np.sort(torso_m if len(torso_m) else depth_m[used])
    # As np.median, which takes ten times as long for so few.
    middle = len(ranked_m) - 1
    return float((ranked_m[middle // 2] + ranked_m[(middle + 1) // 2]) / 2)
