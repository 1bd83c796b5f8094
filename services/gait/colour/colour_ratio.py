"""Likelihood ratio of a box's pixels: colours of the person against those of the background.

A histogram of all of a box does not distinguish a person from half of a person, nor from a shelf of
the same colours. Here each pixel counts by its position in the box: by the probability that people
fill that position, the person's colours at that height, and the background's present colours.

Source: docs/method.md, section 19.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from people4d.messages import F64, U8
from services.gait.colour.histogram import I32, HsvPatch, HueSaturationHistogram
from services.gait.config import ColourLayerConfig

# Probability that a pixel of a box is the person's, in tenths: largest in the middle, falling
# towards the sides; the head is half as wide as the rest.
MIDDLE_TENTHS, HEAD_RATIO = 8.0, 0.15  # in the middle; the head's part of the height
HEAD_WIDTH, BODY_WIDTH = 0.2, 0.4  # where it falls to 1/e, from the middle, in widths of the box
TENTHS = 10
LEARN_POINTS = (32, 72)  # in and about a box, that colours are learnt from
UNSEEN = 3e-4  # probability of a colour that was not observed
RATIO_MAX = 10.0  # bound of one pixel's likelihood ratio


@dataclass(frozen=True)
class ColourModel:
    """Colour histograms of a person and of the background; rows sum to 1."""

    person: F64  # bands x bins, from the top down
    background: F64  # bins

    @cached_property
    def ratios(self) -> F64:
        """Likelihood ratios of colours, person to background, bands x bins."""
        ratios = (self.person + UNSEEN) / (self.background + UNSEEN)
        return np.asarray(np.clip(ratios, 1 / RATIO_MAX, RATIO_MAX))


class SampleGrid(NamedTuple):
    """Points at which boxes are sampled."""

    u: F64  # columns, in widths of the box from its middle
    v: F64  # rows, in heights
    bands: npt.NDArray[np.int64]  # of the rows
    tenths: I32  # rows x columns: probability that the point is the person's; 0 off the box


def sample_grid(points: tuple[int, int], scale: tuple[float, float], bands: int) -> SampleGrid:
    """Return sample points, each in the middle of its cell.

    Args:
        points: Across and down.
        scale: Sides of the sampled area, in those of the box.
        bands: Into which the box's height is divided.
    """
    u, v = (
        side * ((np.arange(count) + 0.5) / count - 0.5)
        for count, side in zip(points, scale, strict=True)
    )
    height = v + 0.5
    width = np.where(height < HEAD_RATIO, HEAD_WIDTH, BODY_WIDTH)[:, None]
    inside = (np.abs(u) < 0.5) & (np.abs(v) < 0.5)[:, None]
    probability = np.rint(MIDDLE_TENTHS * np.exp(-((u / width) ** 4)))
    tenths = np.where(inside, probability, 0).astype(np.int32)
    return SampleGrid(u, v, np.clip(height * bands, 0, bands - 1).astype(np.int64), tenths)


class ColourRatio:
    """Learns colour models and scores boxes by them.

    Args:
        config: Points, bands, and the size of the background about a box.
        histogram: Bins of hue and saturation.
    """

    def __init__(self, config: ColourLayerConfig, histogram: HueSaturationHistogram) -> None:
        self._histogram, self._bands = histogram, config.bands
        scale = config.background_scale, (1 + config.background_scale) / 2
        self.reach = np.array([1.0, 1.0, *scale])  # box times this covers the background
        self._grid = sample_grid(config.points, (1.0, 1.0), config.bands)
        self._learn_grid = sample_grid(LEARN_POINTS, scale, config.bands)

    def learn(self, patch: HsvPatch, box: F64) -> ColourModel:
        """Return the colours of the person in a box and of the background.

        Args:
            patch: Covers the box times `reach`.
            box: [px] 4: centre x, y, width, height.
        """
        tables, bins = self._histogram.tables, self._histogram.bins
        person, background = np.zeros((self._bands, bins)), np.zeros(bins)
        _learn(patch.hsv, patch.origin, *tables, self._learn_grid, box, person, background)
        return ColourModel(_normalised(person), _normalised(background))

    def scores(self, patch: HsvPatch, boxes: F64, model: ColourModel) -> F64:
        """Return the log-likelihood ratios of boxes, person to background.

        Args:
            patch: Covers the boxes.
            boxes: [px] Mx4: centre x, y, width, height.
            model: Of the person.

        Returns:
            M, summed over the pixels of each box.
        """
        tenths = np.arange(TENTHS)[:, None] / TENTHS
        logs = np.log1p(tenths * (model.ratios[:, None] - 1))
        found = np.empty(len(boxes))
        _score(patch.hsv, patch.origin, *self._histogram.tables, self._grid, boxes, logs, found)
        return found


def _normalised(counts: F64) -> F64:
    return np.asarray(counts / np.maximum(counts.sum(axis=-1, keepdims=True), 1e-9))


@compiled
def _learn(
    hsv: U8,
    origin: tuple[int, int],
    hue: I32,
    saturation: I32,
    grid: SampleGrid,
    box: F64,
    person: F64,
    background: F64,
) -> None:
    """Count colours, each point in tenths for the person and for the background."""
    height, width = hsv.shape[:2]
    for j in range(len(grid.v)):
        row = math.floor(box[1] + box[3] * grid.v[j]) - origin[1]
        if row < 0 or row >= height:
            continue
        band = grid.bands[j]
        for i in range(len(grid.u)):
            column = math.floor(box[0] + box[2] * grid.u[i]) - origin[0]
            if 0 <= column < width:
                colour = hue[hsv[row, column, 0]] + saturation[hsv[row, column, 1]]
                person[band, colour] += grid.tenths[j, i]
                background[colour] += TENTHS - grid.tenths[j, i]


@compiled
def _score(
    hsv: U8,
    origin: tuple[int, int],
    hue: I32,
    saturation: I32,
    grid: SampleGrid,
    boxes: F64,
    logs: F64,
    found: F64,
) -> None:
    height, width = hsv.shape[:2]
    cells = len(grid.u) * len(grid.v)
    for m in range(len(boxes)):
        x, y, wide, high = boxes[m]
        total = 0.0
        for j in range(len(grid.v)):
            row = math.floor(y + high * grid.v[j]) - origin[1]
            if row < 0 or row >= height:
                continue
            band = grid.bands[j]
            for i in range(len(grid.u)):
                column = math.floor(x + wide * grid.u[i]) - origin[0]
                if 0 <= column < width:
                    colour = hue[hsv[row, column, 0]] + saturation[hsv[row, column, 1]]
                    total += logs[band, grid.tenths[j, i], colour]
        found[m] = total * wide * high / cells
