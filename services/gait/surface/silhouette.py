"""Head, shoulders, torso and legs by the silhouette of a body (docs/method.md, section 8.2)."""

import numpy as np

from people4d.messages import F64
from services.gait.surface.segmentation import BodySegment, Mask

PARTS = ("head", "shoulders", "torso", "legs")
NECK_RATIO = 0.13  # Height of the head without a visible neck [heights of the body] [Winter 2009]
NECK_ROWS = (0.06, 1 / 3)  # Range of the neck [heights of the body from its top]; published: from 0
# Begin of torso and legs [heads from the top of the head] [Winter 2009]: neck at 0.87, shoulders at
# 0.82, hips at 0.53 of the stature
SHOULDERS_HEADS, HIPS_HEADS = 1.5, 3.6


def part_rows_px(body: BodySegment | None) -> dict[str, int]:
    """Return the first row of each part in the image; empty without a body.

    The narrowest row of the upper third is the neck; torso and legs follow at multiples of the
    head's height.

    Source: docs/method.md, section 8.2 [Winter 2009].
    """
    if body is None or not body.mask.any():
        return {}
    rows = np.flatnonzero(body.mask.any(axis=1))
    top, height = int(rows[0]), int(rows[-1] - rows[0]) + 1
    neck = neck_row(silhouette_widths(body.mask)[top : top + height])
    head = neck if neck is not None else max(round(NECK_RATIO * height), 1)
    heads = np.array([0.0, 1.0, SHOULDERS_HEADS, HIPS_HEADS])
    starts = np.minimum(np.round(top + heads * head), len(body.mask)).astype(int)
    return {name: body.top_px + int(row) for name, row in zip(PARTS, starts, strict=True)}


def silhouette_widths(mask: Mask) -> F64:
    """Return the width of each row of a mask, from its first to its last pixel; 0 if empty."""
    width = mask.shape[1]
    first = np.argmax(mask, axis=1)
    last = width - 1 - np.argmax(mask[:, ::-1], axis=1)
    return np.where(mask.any(axis=1), last - first + 1, 0).astype(np.float64)


def neck_row(widths: F64) -> int | None:
    """Return the row of the neck; None if the silhouette does not narrow above the shoulders."""
    above, below = (round(ratio * len(widths)) for ratio in NECK_ROWS)
    above = max(above, 1)
    if below - above < 3:
        return None
    # Mean of three rows: an outline made of noise has narrow rows everywhere.
    smooth = np.convolve(np.pad(widths, 1, mode="edge"), np.ones(3) / 3, mode="valid")
    narrow = smooth[above:below]
    row = above + int(np.argmin(narrow))
    wider = smooth[:row].max() > smooth[row] and smooth[row:below].max() > smooth[row]
    return row if wider else None
