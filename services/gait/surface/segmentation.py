"""Segmentation of a person in a box of the depth image: holes filled, components labelled.

Source: docs/method.md, section 8.2 (G 4.1).
"""

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from common.compiled import compiled
from people4d.messages import F32, F64, U16

Mask: TypeAlias = npt.NDArray[np.bool_]
I32: TypeAlias = npt.NDArray[np.int32]
I64: TypeAlias = npt.NDArray[np.int64]

FILL_PASSES = 2  # Passes of hole filling; published: 1
FILL_NEIGHBOURS = 3  # Minimum number of neighbours with depth, of 8, of a filled hole; published: 1
# Maximum depth step between neighbouring pixels of one component: constant [m], by the distance
# [m/m] and its square [m/m^2]; 3 sigmas of a stereo camera's noise. Published: 10 mm, for a
# time-of-flight camera at 2 to 3 m
DEPTH_STEPS = (0.010, 0.006, 3.0 * 0.0025)
# Maximum distance from the track's depth of pixels that vote for the component [m]
SEED_WINDOW_M = 0.25
REACH_M = 1.0  # Maximum distance of a part of a person from the track's depth [m]
# Maximum gap in depth to a part occluded at its joint, such as the farther leg [m]; published: 0
JOIN_M = 0.4
JOIN_PX = 4  # Maximum distance in the image of a joined part from the body [px]
PIXELS_MIN = 30  # Minimum number of pixels of a body and of a joined part
STACKED_M = 0.6  # Maximum difference in depth of a large part: a carried object is nearer [m]


@dataclass(frozen=True, kw_only=True)
class BodySegment:
    """Pixels of one person."""

    left_px: int  # first column in the image
    top_px: int  # first row in the image
    depth_m: F32  # hxw, holes filled; 0 off the body
    mask: Mask  # hxw


def segment_body(depth_mm: U16, box_xyxy_px: F64, seed_depth_m: float | None) -> BodySegment | None:
    """Segment a person in the depth image (HxW, 0 = no reading).

    The box may reach out of the image. Without the depth of the person's track the largest
    component is used. None if no component in the box is large enough.
    """
    corners = _clipped(box_xyxy_px, depth_mm.shape)
    if corners is None:
        return None
    left, top, right, bottom = corners
    depth_m = depth_mm[top:bottom, left:right].astype(np.float32) * np.float32(0.001)
    for _ in range(FILL_PASSES):
        depth_m = fill_holes(depth_m, FILL_NEIGHBOURS)
    seed = float("nan") if seed_depth_m is None else float(seed_depth_m)
    if np.isfinite(seed):
        depth_m[np.abs(depth_m - np.float32(seed)) > REACH_M] = 0
    labels, sizes = components(depth_m)
    best = _seeded(depth_m, labels, sizes, seed)
    if best is None:
        return None
    joined = np.zeros(len(sizes), np.bool_)
    joined[best] = True
    _join(depth_m, labels, sizes, joined)
    mask: Mask = joined[labels]
    depth_m *= mask
    return BodySegment(left_px=left, top_px=top, depth_m=depth_m, mask=mask)


def fill_holes(depth_m: F32, neighbours_min: int = 1) -> F32:
    """Set pixels of no reading (0) to the median of the readings about them.

    The median of an even number of readings is the lower middle one: a mean would lie between a
    person and the wall.
    """
    filled = depth_m.copy()
    known = (depth_m > 0).view(np.uint8)
    beside = cv2.boxFilter(known, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
    # Few holes remain: most empty pixels are inside a larger hole.
    holes = np.flatnonzero((known == 0) & (beside >= max(neighbours_min, 1)))
    _fill(depth_m, holes, filled)
    return filled


@compiled
def _fill(depth_m: F32, holes: I64, filled: F32) -> None:
    height, width = depth_m.shape
    near = np.empty(8, np.float32)
    for hole in holes:
        row, column = hole // width, hole % width
        count = 0
        for r in range(max(row - 1, 0), min(row + 2, height)):
            for c in range(max(column - 1, 0), min(column + 2, width)):
                value = depth_m[r, c]
                if value > 0:
                    k = count
                    while k > 0 and near[k - 1] > value:
                        near[k] = near[k - 1]
                        k -= 1
                    near[k] = value
                    count += 1
        filled[row, column] = near[(count - 1) // 2]


def components(depth_m: F32) -> tuple[I32, I64]:
    """Label connected components of continuous depth (HxW, 0 = no reading).

    Returns labels (HxW), 0 for no reading, components from 1 on; and the number of pixels of each.
    """
    known = depth_m > 0
    numbers = np.full(depth_m.shape, -1, np.int32)
    numbers[known] = np.arange(np.count_nonzero(known))
    constant, linear, square = DEPTH_STEPS
    limit_m = np.maximum(constant, linear * depth_m + square * depth_m**2)
    starts, ends = [], []
    for here, there in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        near = np.abs(depth_m[here] - depth_m[there]) < limit_m[here]
        near &= known[here] & known[there]
        starts.append(numbers[here][near])
        ends.append(numbers[there][near])
    edges = np.concatenate(starts), np.concatenate(ends)
    count = int(numbers.max(initial=-1)) + 1
    graph = coo_array((np.ones(len(edges[0]), np.int8), edges), shape=(count, count))
    labels = np.zeros(depth_m.shape, np.int32)
    labels[known] = 1 + connected_components(graph, directed=False)[1]
    return labels, np.bincount(labels.ravel())


def _seeded(depth_m: F32, labels: I32, sizes: I64, seed_m: float) -> int | None:
    """Return the label of the person's component; None if it is too small."""
    votes = sizes.copy()
    votes[0] = 0
    if np.isfinite(seed_m):
        height, width = labels.shape
        middle = np.s_[: max(height * 2 // 3, 1), width // 4 : max(width - width // 4, 1)]
        near = np.abs(depth_m[middle] - np.float32(seed_m)) < SEED_WINDOW_M
        near_seed = np.bincount(labels[middle][near], minlength=len(sizes))
        near_seed[0] = 0
        votes = near_seed if near_seed.any() else votes
    best = int(np.argmax(votes))
    return best if best and sizes[best] >= PIXELS_MIN else None


def _join(depth_m: F32, labels: I32, sizes: I64, joined: Mask) -> None:
    """Add components that are probably parts of the body occluded at their joint.

    Such a part is adjacent to the body in the image and in depth, and within the box: a component
    that reaches the sides of the box is another person, a wall or furniture. A large component is
    part of the body if it is above or below, for example legs below a carried box.
    """
    large = sizes > sizes[joined].sum() // 2
    possible = sizes >= PIXELS_MIN
    possible[0] = False
    possible[labels[:, [0, -1]]] = False
    possible &= ~joined
    stacked = _stacked(depth_m, labels, joined, possible & large)
    possible &= stacked | ~large
    while JOIN_M:
        possible &= ~joined
        if not possible.any():
            return
        adjacent = _touching(depth_m, labels, joined, possible) > JOIN_PX
        if not adjacent.any():
            return
        joined |= adjacent


def _stacked(depth_m: F32, labels: I32, joined: Mask, possible: Mask) -> Mask:
    """Return components with their middle above or below the joined ones, at about their depth.

    Another person at this depth covers the same rows.
    """
    found = np.zeros(len(possible), np.bool_)
    numbers = np.flatnonzero(possible)
    if not len(numbers):
        return found
    body = joined[labels]
    rows, median_m = np.flatnonzero(body.any(axis=1)), float(np.median(depth_m[body]))
    for number in numbers:
        part = labels == number
        middle = float(np.nonzero(part)[0].mean())
        near = abs(float(np.median(depth_m[part])) - median_m) < STACKED_M
        found[number] = near and not rows[0] <= middle <= rows[-1]
    return found


def _touching(depth_m: F32, labels: I32, joined: Mask, possible: Mask) -> I64:
    """Return the pixels of possible components near joined ones, in the image and in depth."""
    body = joined[labels]
    window = np.ones((2 * JOIN_PX + 1,) * 2, np.uint8)
    farthest = cv2.dilate(np.where(body, depth_m, -np.float32(np.inf)), window)
    nearest = cv2.erode(np.where(body, depth_m, np.float32(np.inf)), window)
    near = (depth_m < farthest + JOIN_M) & (depth_m > nearest - JOIN_M) & possible[labels]
    return np.bincount(labels[near], minlength=len(joined))


def _clipped(box: F64, shape: tuple[int, ...]) -> tuple[int, int, int, int] | None:
    """Return left, top, right, bottom of a box's pixels in the image; None if it has none."""
    sides = np.asarray(box, np.float64).ravel()
    if len(sides) != 4 or not np.isfinite(sides).all() or len(shape) != 2:
        return None
    height, width = shape
    limits = (width, height, width, height)
    rounded = np.concatenate([np.floor(sides[:2]), np.ceil(sides[2:])])
    left, top, right, bottom = (int(side) for side in np.clip(rounded, 0, limits))
    return (left, top, right, bottom) if left < right and top < bottom else None
