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
from services.detector.models.base import DetectedPerson, InstanceMask

Flags = npt.NDArray[np.bool_]
TORSO = [5, 6, 11, 12]  # COCO: shoulders and hips
SURFACE_WINDOW_PX = 5  # side of the windows of published keypoint depths [px]
NONE_MM = np.uint16(65535)  # no reading, after the minimum is subtracted [mm]


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

    None if the centroid is outside the mask (a bent body) or has no valid reading. Source:
    docs/method.md section 2, mask [PIC4SeR].
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


def keypoint_mean(keypoints: F32, image: DepthImage, confidence_min: float) -> F64 | None:
    """Return the mean of the surface points at the confident keypoints: 3 in metres, optical frame.

    None if no keypoint (17x3, u and v in pixels, confidence) is both confident and validly read.
    Source: docs/method.md section 2, keypoints [PIC4SeR].
    """
    depth_m = keypoint_depth(keypoints, image, confidence_min)
    used = np.isfinite(depth_m)
    if not used.any():
        return None
    mean: F64 = deproject(keypoints[used, :2], depth_m[used], image.info).mean(axis=0)
    return mean


def keypoint_depth(keypoints: F32, image: DepthImage, confidence_min: float) -> F64:
    """Return the depth at each keypoint: 17 in metres, NaN where it is not used."""
    depth_m = read_depth(keypoints[:, :2].astype(np.float64), image)
    return np.where(keypoints[:, 2] > confidence_min, depth_m, np.nan)


def read_depth(pixels: F64, image: DepthImage, window_px: npt.ArrayLike = 1) -> F64:
    """Return the median of the valid readings around pixels (Nx2), N in metres, NaN if none.

    Args:
        pixels: u and v, rounded to the nearest pixel.
        image: Depth image.
        window_px: Odd side of the windows, one or N; parts beyond the image are left out.
    """
    return read_windows(pixels, image, window_px, 0.0, image.info.max_depth_m)[0]


def read_windows(
    pixels: F64,
    image: DepthImage,
    window_px: npt.ArrayLike,
    nearest_m: npt.ArrayLike,
    farthest_m: npt.ArrayLike,
) -> tuple[F64, F64]:
    """Return the median of the readings between two depths around pixels, and their share.

    Args:
        pixels: Nx2, u and v, rounded to the nearest pixel.
        image: Depth image.
        window_px: Odd side of the windows, one or N; parts beyond the image are left out.
        nearest_m: Minimum depth that counts, one or N; 0 is no reading.
        farthest_m: Maximum depth that counts, one or N.

    Returns:
        Median, N in metres, NaN where no reading counts; share of the window's pixels, N.
    """
    height, width = image.depth_mm.shape
    sides_px = np.asarray(window_px).reshape(-1, 1)
    most_px = int(sides_px.max(initial=1)) // 2
    # Clipped, since a wild coordinate would overflow the integer.
    bounded = np.minimum(np.maximum(pixels, -most_px - 1), max(height, width) + most_px)
    u, v = np.rint(bounded).astype(np.intp).T[..., None]
    reach = np.arange(-most_px, most_px + 1)
    columns, rows, inside = u + reach, v + reach, None
    if (
        sides_px.min(initial=2 * most_px + 1) < len(reach)
        or min(columns.min(initial=0), rows.min(initial=0)) < 0
        or columns.max(initial=0) >= width
        or rows.max(initial=0) >= height
    ):
        near = np.abs(reach) <= sides_px // 2
        inside = (near & (rows >= 0) & (rows < height))[:, :, None]
        inside = inside & (near & (columns >= 0) & (columns < width))[:, None]
        columns = np.minimum(np.maximum(columns, 0), width - 1)
        rows = np.minimum(np.maximum(rows, 0), height - 1)
    indices = (rows * width)[:, :, None] + columns[:, None]
    least_mm = _millimetres(np.ceil(np.multiply(nearest_m, 1000) - 1e-6), 1)
    span_mm = _millimetres(np.floor(np.multiply(farthest_m, 1000) + 1e-6), 1) - least_mm
    # Nearer and missing readings wrap around and are sorted last.
    above_mm = image.depth_mm.reshape(-1)[indices.reshape(len(pixels), len(reach) ** 2)] - least_mm
    if inside is not None:
        inside = inside.reshape(above_mm.shape)
        above_mm[~inside] = NONE_MM
    above_mm.sort(axis=1)
    found = np.count_nonzero(above_mm <= span_mm, axis=1)
    row = np.arange(len(pixels))
    middles = above_mm[row, (found - 1) // 2].astype(np.float64) + above_mm[row, found // 2]
    median_m: F64 = np.where(found > 0, middles / 2000 + least_mm[:, 0] / 1000, np.nan)
    total = above_mm.shape[1] if inside is None else np.maximum(inside.sum(axis=1), 1)
    return median_m, found / total


def _millimetres(depth_mm: npt.ArrayLike, least: int) -> U16:
    """Return limits of readings as a column."""
    return np.minimum(np.maximum(depth_mm, least), NONE_MM).astype(np.uint16).reshape(-1, 1)


def keypoint_surfaces(people: Sequence[DetectedPerson], image: DepthImage) -> list[F32 | None]:
    """Return the depth of the surface at every keypoint of people: 17 in metres each, 0 if unread.

    Surfaces of occluders count, too. None without keypoints.
    """
    pixels = [p.keypoints[:, :2] for p in people if p.keypoints is not None]
    if not pixels:
        return [None] * len(people)
    depth_m = read_depth(np.concatenate(pixels).astype(np.float64), image, SURFACE_WINDOW_PX)
    rows = iter(np.nan_to_num(depth_m).astype(np.float32).reshape(-1, 17))
    return [None if person.keypoints is None else next(rows) for person in people]
