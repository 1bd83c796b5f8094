"""Head, shoulders, torso and legs, from the silhouette of a body."""

from dataclasses import dataclass

import numpy as np

from people4d.messages import F64, U8
from services.gait.surface.body import Body, Mask
from services.gait.surface.body_config import BodyConfig

HEAD, SHOULDERS, TORSO, LEGS = 1, 2, 3, 4
NAMES = ("head", "shoulders", "torso", "legs")
# Of the height: where the neck is if the silhouette shows none (Winter 2009).
NECK_SHARE = 0.13


@dataclass(frozen=True, kw_only=True)
class Parts:
    """The parts of a body. Rows count from the body's first; each is the first of what follows."""

    labels: U8  # hxw: 0 off the body, else HEAD, SHOULDERS, TORSO or LEGS
    top_row: int  # of the head
    neck_row: int  # the last of the head is the one before
    shoulders_row: int  # where the torso begins
    hips_row: int  # where the legs begin
    neck_found: bool  # False: the silhouette has none, it was put where most people have it


def parts_of(body: Body | None, config: BodyConfig) -> Parts | None:
    """Divide a body by the width of its silhouette.

    The narrowest row of the upper third is the neck; how long the head is tells the rest.

    Args:
        body: Its pixels.
        config: Where necks are looked for, and proportions.

    Returns:
        The parts; None if there is no body.

    Source: method book section 8.2 [G 4.1.3].
    """
    if body is None or not body.mask.any():
        return None
    rows = np.flatnonzero(body.mask.any(axis=1))
    top, height = int(rows[0]), int(rows[-1] - rows[0]) + 1
    neck = _neck(silhouette_widths(body.mask)[top : top + height], config)
    head = neck if neck is not None else max(round(NECK_SHARE * height), 1)
    heads = np.array([1.0, config.shoulders_heads, config.hips_heads])
    starts = np.minimum(np.round(top + heads * head), len(body.mask)).astype(int)
    part = np.searchsorted(starts, np.arange(len(body.mask)), side="right") + HEAD
    labels = np.where(body.mask, part[:, None], 0).astype(np.uint8)
    return Parts(
        labels=labels,
        top_row=top,
        neck_row=int(starts[0]),
        shoulders_row=int(starts[1]),
        hips_row=int(starts[2]),
        neck_found=neck is not None,
    )


def rows_px_of(body: Body | None, config: BodyConfig) -> dict[str, int]:
    """Return the first row of each part in the whole image; nothing if there is no body.

    Args:
        body: Its pixels.
        config: As for `parts_of`.
    """
    parts = parts_of(body, config)
    if body is None or parts is None:
        return {}
    rows = (parts.top_row, parts.neck_row, parts.shoulders_row, parts.hips_row)
    return {name: body.top_px + row for name, row in zip(NAMES, rows, strict=True)}


def silhouette_widths(mask: Mask) -> F64:
    """Return from its first to its last pixel how wide each row of a mask is; 0 where empty."""
    width = mask.shape[1]
    first = np.argmax(mask, axis=1)
    last = width - 1 - np.argmax(mask[:, ::-1], axis=1)
    return np.where(mask.any(axis=1), last - first + 1, 0).astype(np.float64)


def _neck(widths: F64, config: BodyConfig) -> int | None:
    """Return the row of the neck; None if the silhouette does not narrow above the shoulders."""
    above, below = (round(share * len(widths)) for share in config.neck_rows)
    above = max(above, 1)
    if below - above < 3:
        return None
    # Mean of three rows: an outline made of noise has narrow rows everywhere.
    smooth = np.convolve(np.pad(widths, 1, mode="edge"), np.ones(3) / 3, mode="valid")
    narrow = smooth[above:below]
    row = above + int(np.argmin(narrow))
    wider = smooth[:row].max() > smooth[row] and smooth[row:below].max() > smooth[row]
    return row if wider else None
