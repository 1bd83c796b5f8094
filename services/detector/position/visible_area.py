"""Visible area of a person's body in the image, by the box and the joints.

It holds the chest and what is visible below, of people whose hips are hidden or cut off too. A grid
of depth samples there outvotes single readings of the background (docs/method.md section 10).
"""

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from people4d.messages import F32, F64, CameraInfo
from services.detector.config import AreaConfig
from services.detector.position.proportions import Flags
from services.detector.position.surface import DepthImage

EMPTY: F64 = np.zeros((0, 2))


def area_pixels(
    box_xyxy_px: F32, joints_px: F64, known: Flags, info: CameraInfo, config: AreaConfig
) -> F64:
    """Return a grid of pixels on the visible body, Nx2, u and v.

    It is in the middle of the box. Where the image cuts the box off to the left or right the body
    goes on there, so that the grid begins at that edge.

    Args:
        box_xyxy_px: Box of the person, may reach beyond the image.
        joints_px: Shoulders and hips, 4x2.
        known: Which of them are known, 4.
        info: The camera.
        config: Extent and density.
    """
    left, top, right, bottom = cut_to_image(box_xyxy_px, info)
    if not (left < right and top < bottom):
        return EMPTY
    rows_px, is_known = joints_px[:, 1].tolist(), known.tolist()
    upper, lower = _mean(rows_px[:2], is_known[:2]), _mean(rows_px[2:], is_known[2:])
    if math.isnan(upper):
        upper = top + config.below_top * (bottom - top)
    if math.isnan(lower) or lower <= upper:
        lower = bottom
    width = config.width * (right - left)
    fraction = (1 + cut_side(box_xyxy_px, info, config)) / 2  # 0: at the left, 1: at the right
    grid: F64 = _grid(config.columns, config.rows) * (width, lower - upper)
    grid += (left + fraction * (right - left - width), upper)
    return grid


@cache
def _grid(columns: int, rows: int) -> F64:
    """Return the middles of the cells of a square of side 1, Nx2."""
    across, down = (np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows
    return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)


def _mean(values: Sequence[float], known: Sequence[bool]) -> float:
    """Return the mean of the known values; NaN if there are none."""
    chosen = [value for value, is_known in zip(values, known, strict=True) if is_known]
    return sum(chosen) / len(chosen) if chosen else math.nan


def read_pixels(pixels: F64, image: DepthImage) -> F64:
    """Return the depth at pixels inside the image (Nx2), N in metres, NaN without a reading."""
    u, v = np.rint(pixels).astype(np.intp).T
    depth_m = image.depth_mm[v, u] / 1000.0
    depth_m[(depth_m == 0) | (depth_m > image.info.max_depth_m)] = np.nan
    return np.asarray(depth_m, np.float64)


def cut_to_image(box_xyxy_px: F32, info: CameraInfo) -> list[float]:
    """Return the part of a box inside the image: left, top, right, bottom; empty if NaN."""
    sides = (info.width - 1.0, info.height - 1.0) * 2
    corners = zip(box_xyxy_px.tolist(), sides, strict=True)
    return [min(max(corner, 0.0), side) if corner == corner else 0.0 for corner, side in corners]


def cut_side(box_xyxy_px: F32, info: CameraInfo, config: AreaConfig) -> int:
    """Return the side on which the image cuts a box off: -1 left, 1 right, 0 neither or both."""
    left, right = float(box_xyxy_px[0]), float(box_xyxy_px[2])
    edge_px = config.edge_ratio * info.width
    return (right > info.width - 1 - edge_px) - (left < edge_px)


def box_torso(box_xyxy_px: F32, depth_m: float, info: CameraInfo, config: AreaConfig) -> F64:
    """Return the middle of the torso at a depth by the box alone: u and v in pixels."""
    left, top, right, bottom = cut_to_image(box_xyxy_px, info)
    v = min(top + config.crown_m * info.fy / depth_m, bottom)
    return np.array([(left + right) / 2, v])


def in_image(pixels: F64, info: CameraInfo, margin_px: float = 0.0) -> Flags:
    """Return which of Nx2 pixels lie in the image, farther than a margin from its edge."""
    first_px = margin_px - 0.5
    last_px = (info.width - 1 - first_px, info.height - 1 - first_px)
    return np.asarray(((pixels > first_px) & (pixels < last_px)).all(axis=1))
