"""Boxes as detectors find them, and the layers of depth inside."""

from collections.abc import Sequence

import numpy as np

from people4d.messages import F64, U16
from scripts.render_people.outfits import Rng

REACH_M = 0.35  # thickness of a layer [m]
LAYERS = 3  # maximum number of layers of a box
PART_MIN = 0.12  # minimum share of a box's readings in a layer
HEIGHT_M = (0.25, 2.6)  # limits of the height of a box at the depth of a layer [m]
READ_MIN = 0.04  # minimum share of pixels with a reading
SAMPLES = 400  # number of sampled pixels of a box
FULL_BOX = 0.6  # share of boxes that include hidden parts of the body


def detector_box(
    rng: Rng, visible_px: F64, full_px: F64, others_px: Sequence[F64], size_px: tuple[int, int]
) -> F64:
    """Draw a detector's box of a person: with errors, some cut off, some around two people.

    Args:
        rng: Random numbers.
        visible_px: Box of the visible part; boxes are left, top, right, bottom.
        full_px: Box of the body in the image, with hidden parts.
        others_px: Boxes of other people.
        size_px: Width and height of the image.
    """
    share = rng.uniform(0, 1, 4) if rng.random() < FULL_BOX else np.zeros(4)
    left, top, right, bottom = (visible_px + share * (full_px - visible_px)).tolist()
    width, height = right - left, bottom - top
    error = rng.random()
    if error < 0.08:
        bottom = top + height * rng.uniform(0.35, 0.8)
    elif error < 0.12:
        top += height * rng.uniform(0.1, 0.35)
    elif error < 0.16:
        if rng.random() < 0.5:
            left += width * rng.uniform(0.2, 0.5)
        else:
            right -= width * rng.uniform(0.2, 0.5)
    elif error < 0.22 and others_px:
        other = others_px[int(rng.integers(len(others_px)))].tolist()
        if min(right, other[2]) > max(left, other[0]):
            left, top = min(left, other[0]), min(top, other[1])
            right, bottom = max(right, other[2]), max(bottom, other[3])
    width, height = right - left, bottom - top
    scale_px = np.array([width, height / 2, width, height])
    box_px = np.array([left, top, right, bottom]) + rng.normal(0, 0.06, 4) * scale_px
    low, high = np.maximum(box_px[:2], 0), np.minimum(box_px[2:], size_px)
    return np.concatenate([low, high])


def empty_box(rng: Rng, size_px: tuple[int, int], focal_px: float) -> F64:
    """Draw a box of the size of a person anywhere in the image."""
    depth_m = rng.uniform(1, 5.5)
    height = rng.uniform(0.7, 1.8) * focal_px / depth_m
    width = height * rng.uniform(0.25, 0.6)
    u, v = rng.uniform(0, size_px[0]), rng.uniform(0.1 * size_px[1], 0.8 * size_px[1])
    low = np.maximum([u - width / 2, v - height / 3], 0)
    high = np.minimum([u + width / 2, v + 2 * height / 3], size_px)
    return np.concatenate([low, high])


def layer_depths(depth_mm: U16, box_px: F64, focal_px: float) -> list[float]:
    """Return depths of possible layers of a person [m], nearest first.

    They are medians of dense readings in the upper middle of a box, at which the box has a
    plausible height. Empty if there are few readings.
    """
    ranked_m, count = _sorted_depths(depth_mm, box_px)
    if len(ranked_m) < max(4, READ_MIN * count):
        return []
    height = (box_px[3] - box_px[1]) / focal_px
    layers_m, k = list[float](), 0
    while k < len(ranked_m) and len(layers_m) < LAYERS:
        end = int(np.searchsorted(ranked_m, ranked_m[k] + REACH_M))
        size_m = height * ranked_m[k:end].mean()
        if end - k >= PART_MIN * len(ranked_m) and HEIGHT_M[0] < size_m < HEIGHT_M[1]:
            # The densest range that begins in this one
            ends = np.searchsorted(ranked_m, ranked_m[k:end] + REACH_M)
            best = int((ends - np.arange(k, end)).argmax())
            layers_m.append(float(np.median(ranked_m[k + best : ends[best]])))
            k = max(int(ends[best]), end)
        else:
            k += max(1, len(ranked_m) // 60)
    return layers_m


def _sorted_depths(depth_mm: U16, box_px: F64) -> tuple[F64, int]:
    """Return the readings of the upper middle of a box in ascending order [m], and all pixels."""
    (left, top, right, bottom), (height, width) = box_px.tolist(), depth_mm.shape
    across, down = right - left, bottom - top
    rows = slice(int(max(0, top + 0.05 * down)), int(min(height, top + 0.65 * down)) + 1)
    columns = slice(int(max(0, left + 0.2 * across)), int(min(width, right - 0.2 * across)) + 1)
    window = depth_mm[rows, columns]
    step = max(1, int(np.sqrt(window.size / SAMPLES)))
    sampled = np.sort(window[::step, ::step].ravel())
    return sampled[sampled > 0].astype(np.float64) / 1000, sampled.size
