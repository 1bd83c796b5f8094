"""Hue-saturation histograms of boxes and their Bhattacharyya distance (docs/method.md, 8.1)."""

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
class HsvPatch:
    """The part of an image that boxes cover, in HSV; the rest is not converted.

    Args:
        hsv: hxwx3.
        origin: Left and top of the patch in the image, pixels.
    """

    hsv: U8
    origin: tuple[int, int]


class HueSaturationHistogram:
    """Histograms of many boxes of one image, in a time that does not grow with the boxes.

    A box is sampled at a grid of points rather than in all its pixels. Points outside of the image
    count in no bin, so that a box that leaves the image becomes less similar.

    Args:
        hue_bins: Of hue.
        saturation_bins: Of saturation.
        points: Of a box, across and down.

    Source: docs/method.md, section 8.1 [Pérez 2002].
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
        # From -1/2 to 1/2 of the box, each point in the middle of its cell.
        self._u = (np.arange(across) + 0.5) / across - 0.5
        self._v = (np.arange(down) + 0.5) / down - 0.5

    def __call__(self, rgb: U8, boxes: F64) -> F64:
        """Return the histograms of boxes.

        Args:
            rgb: HxWx3.
            boxes: [px] Mx4: centre x, y, width, height.

        Returns:
            M x bins, ratio of the points; a row sums to the ratio inside of the image.
        """
        patch = hsv_patch(rgb, boxes)
        found = np.empty((len(boxes), self.bins))
        _histograms(patch.hsv, patch.origin, *self.tables, self._u, self._v, boxes, found)
        return found

    def distances(self, patch: HsvPatch, boxes: F64, reference: F64) -> F64:
        """Return the Bhattacharyya distances of boxes to a reference.

        Args:
            patch: Covers the boxes.
            boxes: [px] Mx4: centre x, y, width, height.
            reference: bins, a person's histogram.

        Returns:
            M, 0 (equal) to 1 (no colour in common).

        Source: docs/method.md, section 8.1 (G 3.7) [Bhattacharyya 1943].
        """
        found = np.empty(len(boxes))
        _distances(patch.hsv, patch.origin, *self.tables, self._u, self._v, boxes, reference, found)
        return found


def hsv_patch(rgb: U8, boxes: F64) -> HsvPatch:
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
        return HsvPatch(np.empty((0, 0, 3), np.uint8), (left, top))
    hsv = np.asarray(cv2.cvtColor(covered, cv2.COLOR_RGB2HSV_FULL), np.uint8)
    return HsvPatch(hsv, (left, top))


@compiled
def _count(
    hsv: U8,
    origin: tuple[int, int],
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
        row = math.floor(box[1] + box[3] * v[j]) - origin[1]
        if row < 0 or row >= height:
            continue
        for i in range(len(u)):
            column = math.floor(box[0] + box[2] * u[i]) - origin[0]
            if 0 <= column < width:
                counts[hue[hsv[row, column, 0]] + saturation[hsv[row, column, 1]]] += 1


@compiled
def _histograms(
    hsv: U8,
    origin: tuple[int, int],
    hue: I32,
    saturation: I32,
    u: F64,
    v: F64,
    boxes: F64,
    found: F64,
) -> None:
    counts = np.empty(found.shape[1], np.int32)
    for m in range(len(boxes)):
        _count(hsv, origin, hue, saturation, u, v, boxes[m], counts)
        found[m] = counts / (len(u) * len(v))


@compiled
def _distances(
    hsv: U8,
    origin: tuple[int, int],
    hue: I32,
    saturation: I32,
    u: F64,
    v: F64,
    boxes: F64,
    reference: F64,
    found: F64,
) -> None:
    ratio = 1.0 / (len(u) * len(v))
    bins = np.flatnonzero(reference)  # others add nothing
    counts = np.empty(len(reference), np.int32)
    for m in range(len(boxes)):
        _count(hsv, origin, hue, saturation, u, v, boxes[m], counts)
        coefficient = 0.0
        for b in bins:
            coefficient += math.sqrt(counts[b] * ratio * reference[b])
        found[m] = math.sqrt(min(max(1.0 - coefficient, 0.0), 1.0))


def log_likelihoods(distances: F64, sigma: float) -> F64:
    """Return log-likelihoods of particles by their distance to the reference (G 3.8)."""
    return np.asarray(-(distances**2) / (2 * sigma**2))


def normalised_weights(logs: F64) -> F64:
    """Return weights, ... x N, each row of which sums to 1, by their logarithms (G 3.9)."""
    # Only ratios count: without the maximum all would be 0 for a small sigma.
    weights = np.exp(logs - logs.max(axis=-1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=-1, keepdims=True))
