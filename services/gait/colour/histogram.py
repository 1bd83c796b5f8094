"""Hue-saturation histograms of boxes, and how alike they are (method book section 8.1)."""

import math
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from people4d.messages import F64, U8

I32: TypeAlias = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Part:
    """The part of an image that boxes cover, as hue and saturation; the rest is never converted.

    Args:
        hsv: hxwx3.
        left: Of the part in the image, pixels; with top.
    """

    hsv: U8
    left: int
    top: int


class HueSaturation:
    """Tells the colours of many boxes of one image, in a time that no box's size changes.

    A box is looked at in a grid of points rather than in all its pixels. Points outside of the
    image have no colour but count, so that a box that leaves the image grows less alike.

    Args:
        hue_bins: Of hue.
        saturation_bins: Of saturation.
        points: Of a box, across and down.

    Source: method book section 8.1.
    """

    def __init__(self, hue_bins: int, saturation_bins: int, points: tuple[int, int]) -> None:
        self.bins = hue_bins * saturation_bins
        levels = np.arange(256)
        # By the value of a pixel: what hue and saturation add to the number of its bin.
        self.tables: tuple[I32, I32] = (
            (levels * hue_bins // 256 * saturation_bins).astype(np.int32),
            (levels * saturation_bins // 256).astype(np.int32),
        )
        across, down = points
        # Where the points lie in a box from -1/2 to 1/2, each in the middle of its cell.
        self._u = (np.arange(across) + 0.5) / across - 0.5
        self._v = (np.arange(down) + 0.5) / down - 0.5

    def __call__(self, rgb: U8, boxes: F64) -> F64:
        """Return the histograms of boxes.

        Args:
            rgb: HxWx3.
            boxes: [px] Mx4: centre x, y, width, height.

        Returns:
            M x bins, share of the points; a row sums to the share inside of the image.
        """
        part = part_of(rgb, boxes)
        found = np.empty((len(boxes), self.bins))
        where = part.left, part.top
        _histograms(part.hsv, where, *self.tables, self._u, self._v, boxes, found)
        return found

    def distances(self, part: Part, boxes: F64, reference: F64) -> F64:
        """Compare the colours of boxes with a person's.

        Args:
            part: Of the image, covers the boxes.
            boxes: [px] Mx4: centre x, y, width, height.
            reference: bins, the person's histogram.

        Returns:
            M Bhattacharyya distances.
        """
        found = np.empty(len(boxes))
        where = part.left, part.top
        _compare(part.hsv, where, *self.tables, self._u, self._v, boxes, reference, found)
        return found


def part_of(rgb: U8, boxes: F64) -> Part:
    """Return the part of an image that any of the boxes covers.

    Args:
        rgb: HxWx3.
        boxes: [px] Mx4: centre x, y, width, height.
    """
    height, width = rgb.shape[:2]
    low = (boxes[:, :2] - boxes[:, 2:] / 2).min(axis=0, initial=max(height, width))
    high = (boxes[:, :2] + boxes[:, 2:] / 2).max(axis=0, initial=0.0)
    left, top = np.clip(np.floor(low), 0, (width, height)).astype(int).tolist()
    right, bottom = np.clip(np.ceil(high) + 1, (left, top), (width, height)).astype(int).tolist()
    covered = rgb[top:bottom, left:right]
    if not covered.size:
        return Part(np.empty((0, 0, 3), np.uint8), left, top)
    return Part(np.asarray(cv2.cvtColor(covered, cv2.COLOR_RGB2HSV_FULL), np.uint8), left, top)


@compiled
def _count(
    hsv: U8,
    where: tuple[int, int],
    hue: I32,
    saturation: I32,
    u: F64,
    v: F64,
    box: F64,
    counts: I32,
) -> None:
    """Count the points of a box in each bin."""
    height, width = hsv.shape[:2]
    counts[:] = 0
    for j in range(len(v)):
        row = math.floor(box[1] + box[3] * v[j]) - where[1]
        if row < 0 or row >= height:
            continue
        for i in range(len(u)):
            column = math.floor(box[0] + box[2] * u[i]) - where[0]
            if 0 <= column < width:
                counts[hue[hsv[row, column, 0]] + saturation[hsv[row, column, 1]]] += 1


@compiled
def _histograms(
    hsv: U8,
    where: tuple[int, int],
    hue: I32,
    saturation: I32,
    u: F64,
    v: F64,
    boxes: F64,
    found: F64,
) -> None:
    counts = np.empty(found.shape[1], np.int32)
    for m in range(len(boxes)):
        _count(hsv, where, hue, saturation, u, v, boxes[m], counts)
        found[m] = counts / (len(u) * len(v))


@compiled
def _compare(
    hsv: U8,
    where: tuple[int, int],
    hue: I32,
    saturation: I32,
    u: F64,
    v: F64,
    boxes: F64,
    reference: F64,
    found: F64,
) -> None:
    share = 1.0 / (len(u) * len(v))
    bins = np.flatnonzero(reference)  # others add nothing
    counts = np.empty(len(reference), np.int32)
    for m in range(len(boxes)):
        _count(hsv, where, hue, saturation, u, v, boxes[m], counts)
        alike = 0.0
        for b in bins:
            alike += math.sqrt(counts[b] * share * reference[b])
        found[m] = math.sqrt(min(max(1.0 - alike, 0.0), 1.0))


def bhattacharyya(p: F64, q: F64) -> F64:
    """Return the Bhattacharyya distance of histograms, 0 (equal) to 1 (nothing in common).

    Args:
        p: ... x bins, each row sums to at most 1.
        q: The same, or one row for all.

    Source: method book section 8.1 [G 3.7].
    """
    alike = np.sqrt(p * q).sum(axis=-1)
    return np.asarray(np.sqrt(np.clip(1.0 - alike, 0.0, 1.0)))


def logs_of(distances: F64, sigma: float) -> F64:
    """Return the logarithms of particles' weights by their distance to the reference.

    Args:
        distances: Any shape.
        sigma: Of the distance.

    Source: method book section 8.1 [G 3.8].
    """
    return np.asarray(-(distances**2) / (2 * sigma**2))


def weights_of(logs: F64) -> F64:
    """Return weights by their logarithms.

    Args:
        logs: ... x N.

    Returns:
        ... x N, each row sums to 1.

    Source: method book section 8.1 [G 3.9].
    """
    # Only ratios count: without this all would be 0 for a small sigma.
    weights = np.exp(logs - logs.max(axis=-1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=-1, keepdims=True))
