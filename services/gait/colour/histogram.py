"""Hue-saturation histograms of boxes and their Bhattacharyya distance (docs/method.md, 8.1)."""

import math
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np

from common.compiled import compiled
from people4d.messages import F64, U8
from services.gait.surface.segmentation import I32

Tables: TypeAlias = tuple[I32, I32]
BINS = (20, 20)  # Bins of hue and of saturation
SAMPLES = (12, 32)  # Samples of a box of any size, across and down


class HsvPatch(NamedTuple):
    """The part of an image that boxes cover, in HSV; the rest is not converted."""

    hsv: U8  # hxwx3
    left: int  # [px] left column of the patch in the image
    top: int


class SampleGrid(NamedTuple):
    """Points at which boxes are sampled, each in the middle of its cell."""

    u: F64  # columns, in widths of the box from its middle
    v: F64  # rows, in heights


def sample_grid(points: tuple[int, int], scale: tuple[float, float] = (1.0, 1.0)) -> SampleGrid:
    """Return points across and down; `scale`: sides of the sampled area [sides of the box]."""
    u, v = (
        side * ((np.arange(count) + 0.5) / count - 0.5)
        for count, side in zip(points, scale, strict=True)
    )
    return SampleGrid(u, v)


class HueSaturationHistogram:
    """Histograms of many boxes of one image, in a time independent of their size.

    A box is sampled at a grid of points rather than in all its pixels. Points outside of the image
    count in no bin, so a box that leaves the image becomes less similar.

    Source: docs/method.md, section 8.1 [Pérez 2002].
    """

    def __init__(self, samples: tuple[int, int] = SAMPLES) -> None:
        hue_bins, saturation_bins = BINS
        self.bins = hue_bins * saturation_bins
        levels = np.arange(256)
        # Contributions of hue and saturation to the bin number, by the value of a pixel.
        self.tables: Tables = (
            (levels * hue_bins // 256 * saturation_bins).astype(np.int32),
            (levels * saturation_bins // 256).astype(np.int32),
        )
        self._grid = sample_grid(samples)

    def __call__(self, rgb: U8, boxes: F64) -> F64:
        """Return the histograms (M x bins) of boxes (Mx4: centre x, y, width, height) of an image.

        A row sums to the ratio of the points that are inside of the image.
        """
        patch, found = hsv_patch(rgb, boxes), np.empty((len(boxes), self.bins))
        bins = np.empty((len(self._grid.v), len(self._grid.u)), np.int32)
        for box, row in zip(boxes, found, strict=True):
            sample_bins(patch, self.tables, self._grid, box, bins)
            row[:] = np.bincount(bins[bins >= 0], minlength=self.bins) / bins.size
        return found

    def measure_distances(self, patch: HsvPatch, boxes: F64, reference: F64) -> F64:
        """Return the Bhattacharyya distances (M, 0 to 1) of boxes in a patch to a reference.

        Source: docs/method.md, section 8.1 (G 3.7) [Bhattacharyya 1943].
        """
        found = np.empty(len(boxes))
        _distances(patch, self.tables, self._grid, boxes, reference, found)
        return found


def hsv_patch(rgb: U8, boxes: F64) -> HsvPatch:
    """Return the part of an image (HxWx3) that any box (Mx4: x, y, width, height) covers."""
    height, width = rgb.shape[:2]
    low = (boxes[:, :2] - boxes[:, 2:] / 2).min(axis=0, initial=max(height, width))
    high = (boxes[:, :2] + boxes[:, 2:] / 2).max(axis=0, initial=0.0)
    left, top = np.clip(np.floor(low), 0, (width, height)).astype(int).tolist()
    right, bottom = np.clip(np.ceil(high) + 1, (left, top), (width, height)).astype(int).tolist()
    covered = rgb[top:bottom, left:right]
    if not covered.size:
        return HsvPatch(np.empty((0, 0, 3), np.uint8), left, top)
    hsv = np.asarray(cv2.cvtColor(covered, cv2.COLOR_RGB2HSV_FULL), np.uint8)
    return HsvPatch(hsv, left, top)


@compiled
def sample_bins(patch: HsvPatch, tables: Tables, grid: SampleGrid, box: F64, bins: I32) -> None:
    """Set the bin of each sample of a box, rows x columns; -1 outside of the image."""
    height, width = patch.hsv.shape[:2]
    bins[:] = -1
    for j in range(len(grid.v)):
        row = math.floor(box[1] + box[3] * grid.v[j]) - patch.top
        if row < 0 or row >= height:
            continue
        for i in range(len(grid.u)):
            column = math.floor(box[0] + box[2] * grid.u[i]) - patch.left
            if 0 <= column < width:
                hue, saturation = patch.hsv[row, column, 0], patch.hsv[row, column, 1]
                bins[j, i] = tables[0][hue] + tables[1][saturation]


@compiled
def _distances(
    patch: HsvPatch, tables: Tables, grid: SampleGrid, boxes: F64, reference: F64, found: F64
) -> None:
    bins = np.empty((len(grid.v), len(grid.u)), np.int32)
    ratio = 1.0 / bins.size
    filled = np.flatnonzero(reference)  # empty bins add 0
    counts = np.empty(len(reference), np.int32)
    for m in range(len(boxes)):
        sample_bins(patch, tables, grid, boxes[m], bins)
        counts[:] = 0
        for b in bins.flat:
            if b >= 0:
                counts[b] += 1
        coefficient = 0.0
        for k in filled:
            coefficient += math.sqrt(counts[k] * ratio * reference[k])
        found[m] = math.sqrt(min(max(1.0 - coefficient, 0.0), 1.0))


def log_likelihoods(distances: F64, sigma: float) -> F64:
    """Return log-likelihoods of particles by their distance to the reference (G 3.8)."""
    return np.asarray(-(distances**2) / (2 * sigma**2))


def normalised_weights(logs: F64) -> F64:
    """Return weights, ... x N, by their logarithms; each row sums to 1 (G 3.9)."""
    # Only ratios matter; subtracting the maximum avoids underflow for a small sigma.
    weights = np.exp(logs - logs.max(axis=-1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=-1, keepdims=True))
