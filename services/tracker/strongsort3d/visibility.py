"""Geometry of people in the image: intervals, boxes and their overlaps.

An interval is the part of the image, at focal length 1, that an upright person's width takes.
"""

import numpy as np

from common.geometry.transforms import apply
from people4d.messages import F64
from services.tracker.motion.track_record import BOOL

NEAR_M = 0.3  # [m] people nearer to the camera's plane than this are not in its view
EDGE_RATIO = 0.02  # of the image's width: a box so near to its edge may be cut off


SIDES = np.array([-1.0, 1.0])


def intervals(positions_m: F64, camera_from_map: F64, half_width_m: float) -> tuple[F64, F64]:
    """Return intervals (Nx2: left, right) and depths (N, m) of people at positions (Nx3)."""
    points = apply(camera_from_map, positions_m)
    depth = points[:, 2]
    scale = 1.0 / np.where(depth > NEAR_M, depth, 1.0)
    centre, half = points[:, 0] * scale, half_width_m * scale
    return centre[:, None] + half[:, None] * SIDES, depth


def overlaps(intervals: F64, others: F64) -> F64:
    """Return the lengths (NxM, below 0 if apart) that intervals (Nx2, Mx2) have in common."""
    high = np.minimum(intervals[:, None, 1], others[:, 1])
    return np.asarray(high - np.maximum(intervals[:, None, 0], others[:, 0]))


def overlap_ratios(intervals: F64, others: F64) -> F64:
    """Return the part (NxM, below 0 if apart) of each interval (Nx2) that each other one covers."""
    ratio: F64 = overlaps(intervals, others) / (intervals[:, 1] - intervals[:, 0])[:, None]
    return ratio


def cut_off(boxes: F64, size_px: tuple[int, int] | None) -> BOOL:
    """Return the boxes (Nx4, xyxy, pixels) that reach the left or right of an image of a size."""
    if size_px is None:
        return np.zeros(len(boxes), np.bool_)
    edge = EDGE_RATIO * size_px[0]
    return np.asarray((boxes[:, 0] < edge) | (boxes[:, 2] > size_px[0] - edge))


def common_ratios(boxes: F64) -> F64:
    """Return the part (NxN) of each box (Nx4, xyxy, pixels) that each other one covers."""
    left, top, right, bottom = np.ascontiguousarray(boxes.T)
    width = np.minimum(right[:, None], right) - np.maximum(left[:, None], left)
    height = np.minimum(bottom[:, None], bottom) - np.maximum(top[:, None], top)
    common = np.maximum(width, 0.0) * np.maximum(height, 0.0)
    area = common.diagonal().copy()  # each box covers itself
    common.flat[:: len(boxes) + 1] = 0.0
    ratios: F64 = common / area[:, None]
    return ratios
