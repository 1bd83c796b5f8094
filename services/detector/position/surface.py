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
Indices = npt.NDArray[np.intp]
TORSO = [5, 6, 11, 12]  # COCO: shoulders and hips
SURFACE_WINDOW_PX = 5  # side of the windows of published keypoint depths [px]
FARTHEST_MM = 1 << 16  # above all readings [mm]
BOTH = np.array([[1], [0]])  # an even number of readings has two middle ones
ROUNDING_MM: F64 = np.array([[-1e-6], [1e-6]])  # allowance of the limits of depths [mm]


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
    person: float | None = None  # probability of a person, 0 to 1; None if it is not estimated


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
    return DepthWindows(pixels, image, window_px).medians(0.0, image.info.max_depth_m)[0]


class DepthWindows:
    """Windows of depth around N pixels, cut and sorted once, read between any depths.

    Args:
        pixels: Nx2, u and v, rounded to the nearest pixel.
        image: Depth image.
        window_px: Odd side of the windows, one or N; parts beyond the image are left out.
    """

    def __init__(self, pixels: F64, image: DepthImage, window_px: npt.ArrayLike) -> None:
        halves_px = np.asarray(window_px).reshape(-1, 1) // 2
        most_px, depth_mm = int(halves_px.max(initial=0)), image.depth_mm
        height, width = depth_mm.shape
        down, across = min(2 * most_px + 1, height), min(2 * most_px + 1, width)
        # Clipped, since a wild coordinate would overflow the integer.
        bounded = np.fmin(np.fmax(pixels, -most_px - 1), max(height, width) + most_px)
        middles = np.rint(bounded).astype(np.intp)
        # At the image's edge a window of full size is moved inside, and its rest does not count.
        limits = (width - across, height - down)
        starts = np.minimum(np.maximum(middles - most_px, 0), limits)
        offsets = starts - middles
        columns = np.abs(offsets[:, :1] + np.arange(across)) <= halves_px
        rows = np.abs(offsets[:, 1:] + np.arange(down)) <= halves_px
        views = np.lib.stride_tricks.as_strided(
            depth_mm, (height - down + 1, width - across + 1, down, across), depth_mm.strides * 2
        )
        read_mm = np.multiply(
            views[starts[:, 1], starts[:, 0]],
            rows[:, :, None] & columns[:, None],
            dtype=np.int32,
        ).reshape(len(pixels), down * across)
        read_mm.sort(axis=1)
        # Each window begins above the one before: one search finds the limits of all.
        self._base_mm = np.arange(len(pixels), dtype=np.int32) * FARTHEST_MM
        read_mm += self._base_mm[:, None]
        self._read_mm = read_mm.reshape(-1)
        self._rows, self._columns = rows, columns

    def medians(self, nearest_m: npt.ArrayLike, farthest_m: npt.ArrayLike) -> tuple[F64, Indices]:
        """Return the median of the readings between two depths, and their number.

        Args:
            nearest_m: Minimum depth that counts, one or for each window; 0 is no reading.
            farthest_m: Maximum depth that counts, one or for each window.

        Returns:
            Median, in metres, NaN where no reading counts; number of readings.
        """
        limits_mm = np.empty((2, len(self._base_mm)))
        limits_mm[0], limits_mm[1] = nearest_m, farthest_m
        limits_mm = np.ceil(limits_mm * 1000 + ROUNDING_MM)
        limits_mm = np.minimum(np.maximum(limits_mm, 1), FARTHEST_MM).astype(np.int32)
        first, end = self._read_mm.searchsorted(limits_mm + self._base_mm)
        found = np.maximum(end - first, 0)
        pairs = first + (found - BOTH) // 2
        pairs_mm = self._read_mm.take(pairs, mode="clip") - self._base_mm
        return np.where(found > 0, pairs_mm.sum(axis=0) / 2000, np.nan), found

    def sizes(self) -> Indices:
        """Return the number of pixels of each window."""
        sizes: Indices = self._rows.sum(axis=1) * self._columns.sum(axis=1)
        return sizes


def keypoint_surfaces(people: Sequence[DetectedPerson], image: DepthImage) -> list[F32 | None]:
    """Return the depth of the surface at every keypoint of people: 17 in metres each, 0 if unread.

    Surfaces of occluders count, too. None without keypoints.
    """
    pixels = [p.keypoints[:, :2] for p in people if p.keypoints is not None]
    if not pixels:
        return [None] * len(people)
    depth_m = read_depth(np.concatenate(pixels).astype(np.float64), image, SURFACE_WINDOW_PX)
    rows = iter(np.where(depth_m > 0, depth_m, 0.0).astype(np.float32).reshape(-1, 17))
    return [None if person.keypoints is None else next(rows) for person in people]
