"""Hue-saturation histograms of boxes, and how alike they are (method book section 8.1)."""

import math
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from common.messages import F64, U8

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
        self._hue = (levels * hue_bins // 256 * saturation_bins).astype(np.int32)
        self._saturation = (levels * saturation_bins // 256).astype(np.int32)
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
        _histograms(part.hsv, (part.left, part.top), *self._tables(), boxes, found)
        return found

    def compare(self, part: Part, boxes: F64, reference: F64, surround: float) -> tuple[F64, F64]:
        """Compare the colours of boxes, and of what surrounds them, with a person's.

        A box of twice the area is looked at, too: what is not of the box itself surrounds it.

        Args:
            part: Of the image, from `part_of` these boxes or wider ones.
            boxes: [px] Mx4: centre x, y, width, height.
            reference: bins, the person's histogram.
            surround: How much alike surroundings speak against a box; 0: they are not looked at.

        Returns:
            M Bhattacharyya distances, and M with what the surroundings add to them.
        """
        distances, judged = np.empty((2, len(boxes)))
        where = part.left, part.top
        _compare(part.hsv, where, *self._tables(), boxes, reference, surround, distances, judged)
        return distances, judged

    def _tables(self) -> tuple[I32, I32, F64, F64]:
        return self._hue, self._saturation, self._u, self._v


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
    surround: float,
    distances: F64,
    judged: F64,
) -> None:
    share = 1.0 / (len(u) * len(v))
    bins = np.flatnonzero(reference)  # others add nothing
    counts = np.empty(len(reference), np.int32)
    wider_counts = np.empty(len(reference), np.int32)
    wider = np.empty(4)
    for m in range(len(boxes)):
        _count(hsv, where, hue, saturation, u, v, boxes[m], counts)
        alike = 0.0
        for b in bins:
            alike += math.sqrt(counts[b] * share * reference[b])
        squared = min(max(1.0 - alike, 0.0), 1.0)
        distances[m] = judged[m] = math.sqrt(squared)
        if surround == 0.0:
            continue
        wider[:2] = boxes[m, :2]
        wider[2:] = boxes[m, 2:] * math.sqrt(2.0)
        _count(hsv, where, hue, saturation, u, v, wider, wider_counts)
        alike = 0.0
        for b in bins:
            around = 2 * wider_counts[b] - counts[b]
            if around > 0:
                alike += math.sqrt(min(around * share, 1.0) * reference[b])
        judged[m] = math.sqrt(squared + (surround * min(alike, 1.0)) ** 2)


def bhattacharyya(p: F64, q: F64) -> F64:
    """Return the Bhattacharyya distance of histograms, 0 (equal) to 1 (nothing in common).

    Args:
        p: ... x bins, each row sums to at most 1.
        q: The same, or one row for all.

    Source: method book section 8.1 [G 3.7].
    """
    alike = np.sqrt(p * q).sum(axis=-1)
    return np.asarray(np.sqrt(np.clip(1.0 - alike, 0.0, 1.0)))


def weights_of(distances: F64, sigma: float) -> F64:
    """Return the weights of particles by their distance to the reference.

    Args:
        distances: ... x N.
        sigma: Of the distance.

    Returns:
        ... x N, each row sums to 1.

    Source: method book section 8.1 [G 3.8, 3.9].
    """
    exponents = -(distances**2) / (2 * sigma**2)
    # Only ratios count: without this all would be 0 for a small sigma.
    weights = np.exp(exponents - exponents.max(axis=-1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=-1, keepdims=True))
