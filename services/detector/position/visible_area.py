"""Visible area of a person's body in the image, by the box and the joints.

It contains the chest and the visible parts below, even with hidden or cut-off hips. A grid of depth
samples there outvotes readings of the background (docs/method.md section 10).
"""

import math
from collections.abc import Sequence

import numpy as np

from people4d.messages import F64, CameraInfo
from services.detector.position.surface import DepthImage, Flags

COLUMNS, ROWS = 6, 8  # number of depth samples across and downward
WIDTH = 0.5  # width of the area, relative to the box
EDGE_RATIO = 0.02  # maximum distance of a cut-off box from the edge, relative to the image's width
BELOW_TOP = 0.3  # upper edge of the area without shoulders, relative to the box's height
# Middles of the cells of a square of side 1, Nx2
GRID: F64 = np.stack(
    np.meshgrid((np.arange(COLUMNS) + 0.5) / COLUMNS, (np.arange(ROWS) + 0.5) / ROWS), axis=-1
).reshape(-1, 2)


def visible_area(
    box_xyxy_px: Sequence[float],
    joints_px: Sequence[Sequence[float]],
    known: Sequence[bool],
    info: CameraInfo,
) -> tuple[float, float, float, float] | None:
    """Return the visible body's area in the image: left, top, width, height; None if outside.

    It is in the middle of the box. If the image cuts the box off to the left or right, the area
    begins at that edge, beyond which the body continues.

    Args:
        box_xyxy_px: Box of the person, may reach beyond the image.
        joints_px: Shoulders and hips, u and v.
        known: Flags of the known joints.
        info: Calibration of the camera.
    """
    left, top, right, bottom = cut_to_image(box_xyxy_px, info)
    if not (left < right and top < bottom):
        return None
    rows_px = [v for _, v in joints_px]
    upper, lower = _mean(rows_px[:2], known[:2]), _mean(rows_px[2:], known[2:])
    if math.isnan(upper):
        upper = top + BELOW_TOP * (bottom - top)
    if math.isnan(lower) or lower <= upper:
        lower = bottom
    width = WIDTH * (right - left)
    fraction = (1 + cut_side(box_xyxy_px, info)) / 2  # 0: at the left, 1: at the right
    return left + fraction * (right - left - width), upper, width, lower - upper


def area_grids(areas: Sequence[tuple[float, float, float, float]]) -> F64:
    """Return a grid of pixels in each of N areas, NxGx2, u and v."""
    rectangles = np.array(areas).reshape(-1, 1, 4)
    grids: F64 = GRID * rectangles[..., 2:] + rectangles[..., :2]
    return grids


def _mean(values: Sequence[float], known: Sequence[bool]) -> float:
    """Return the mean of the known values; NaN if there are none."""
    chosen = [value for value, is_known in zip(values, known, strict=True) if is_known]
    return sum(chosen) / len(chosen) if chosen else math.nan


def read_pixels(pixels: F64, image: DepthImage) -> F64:
    """Return the depth at pixels inside the image (Nx2), N in metres, NaN if unread."""
    u, v = np.rint(pixels).astype(np.intp).T
    depth_m = image.depth_mm[v, u] / 1000.0
    depth_m[(depth_m == 0) | (depth_m > image.info.max_depth_m)] = np.nan
    return np.asarray(depth_m, np.float64)


def cut_to_image(box_xyxy_px: Sequence[float], info: CameraInfo) -> list[float]:
    """Return the part of a box inside the image: left, top, right, bottom; empty if NaN."""
    sides = (info.width - 1.0, info.height - 1.0) * 2
    corners = zip(box_xyxy_px, sides, strict=True)
    return [min(max(corner, 0.0), side) if corner == corner else 0.0 for corner, side in corners]


def cut_side(box_xyxy_px: Sequence[float], info: CameraInfo) -> int:
    """Return the side on which the image cuts a box off: -1 left, 1 right, 0 neither or both."""
    edge_px = EDGE_RATIO * info.width
    return (box_xyxy_px[2] > info.width - 1 - edge_px) - (box_xyxy_px[0] < edge_px)


def in_image(pixels: F64, info: CameraInfo, margin_px: float = 0.0) -> Flags:
    """Return flags of pixels (...x2) in the image, farther than a margin from its edge."""
    first_px = margin_px - 0.5
    last_px = (info.width - 1 - first_px, info.height - 1 - first_px)
    return np.asarray(((pixels > first_px) & (pixels < last_px)).all(axis=-1))
