"""Likelihood ratio of the pixels of a box: colours of the person over the background.

The histogram of a box does not distinguish a person from half of a person, or from furniture of the
same colours. Here each pixel counts by the probability that the person fills its position in the
box, the person's colours at this height, and the current background.

Source: docs/method.md, section 19.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from people4d.messages import F64
from services.gait.colour.histogram import (
    SAMPLES,
    HsvPatch,
    HueSaturationHistogram,
    SampleGrid,
    Tables,
    sample_bins,
    sample_grid,
)
from services.gait.surface.segmentation import I32

# Probability that a pixel of a box belongs to the person: largest in the middle, falling towards
# the sides; the head is half as wide as the rest.
MIDDLE_TENTHS, HEAD_RATIO = 8.0, 0.15  # Probability in the middle [tenths]; share of the head
# Distance from the middle at which the probability is 1/e [widths of the box]
HEAD_WIDTH, BODY_WIDTH = 0.2, 0.4
TENTHS = 10
BANDS = 4  # Number of parts of the height, each with separate colours
BACKGROUND_SCALE = 1.6  # Width of the background about a box [widths of the box]
LEARN_POINTS = (32, 72)  # Samples in and about a box for learning, across and down
UNSEEN = 3e-4  # Probability of an unobserved colour
RATIO_MAX = 10.0  # Maximum likelihood ratio of one pixel


@dataclass(frozen=True)
class ColourModel:
    """Colour histograms of a person and of the background; rows sum to 1."""

    person: F64  # bands x bins, bands from the top down
    background: F64  # bins, histogram of the background

    @cached_property
    def ratios(self) -> F64:
        """Likelihood ratios of colours, person to background, bands x bins."""
        ratios = (self.person + UNSEEN) / (self.background + UNSEEN)
        return np.asarray(np.clip(ratios, 1 / RATIO_MAX, RATIO_MAX))


class PersonPrior(NamedTuple):
    """Prior of the samples of a box."""

    bands: npt.NDArray[np.int64]  # index of the band by row
    tenths: I32  # rows x columns: probability that the point belongs to the person; 0 off the box


def person_prior(grid: SampleGrid, bands: int) -> PersonPrior:
    """Return the prior of samples, with the box's height divided into bands."""
    height = grid.v + 0.5
    width = np.where(height < HEAD_RATIO, HEAD_WIDTH, BODY_WIDTH)[:, None]
    inside = (np.abs(grid.u) < 0.5) & (np.abs(grid.v) < 0.5)[:, None]
    probability = np.rint(MIDDLE_TENTHS * np.exp(-((grid.u / width) ** 4)))
    tenths = np.where(inside, probability, 0).astype(np.int32)
    return PersonPrior(np.clip(height * bands, 0, bands - 1).astype(np.int64), tenths)


class ColourRatio:
    """Learns colour models and scores boxes by them."""

    def __init__(self, histogram: HueSaturationHistogram, bands: int = BANDS) -> None:
        self._histogram, self._bands = histogram, bands
        scale = BACKGROUND_SCALE, (1 + BACKGROUND_SCALE) / 2
        self.reach = np.array([1.0, 1.0, *scale])  # factors of a box that covers the background
        self._grid = sample_grid(SAMPLES)
        self._prior = person_prior(self._grid, bands)
        self._learn_grid = sample_grid(LEARN_POINTS, scale)
        self._learn_prior = person_prior(self._learn_grid, bands)

    def learn_colours(self, patch: HsvPatch, box: F64) -> ColourModel:
        """Return the colours of the person in a box (4: x, y, width, height) and of the background.

        The patch covers the box times `reach`.
        """
        count = self._histogram.bins
        person, background = np.zeros((self._bands, count)), np.zeros(count)
        bins = np.empty(self._learn_prior.tenths.shape, np.int32)
        sample_bins(patch, self._histogram.tables, self._learn_grid, box, bins)
        _learn(bins, self._learn_prior, person, background)
        return ColourModel(_normalised(person), _normalised(background))

    def score_boxes(self, patch: HsvPatch, boxes: F64, model: ColourModel) -> F64:
        """Return the log-likelihood ratios (M) of boxes (Mx4) in a patch, person to background.

        They are summed over the pixels of each box.
        """
        tenths = np.arange(TENTHS)[:, None] / TENTHS
        logs = np.log1p(tenths * (model.ratios[:, None] - 1))
        found = np.empty(len(boxes))
        tables = self._histogram.tables
        _score(patch, tables, self._grid, self._prior, boxes, logs, found)
        return found


def _normalised(counts: F64) -> F64:
    return np.asarray(counts / np.maximum(counts.sum(axis=-1, keepdims=True), 1e-9))


@compiled
def _learn(bins: I32, prior: PersonPrior, person: F64, background: F64) -> None:
    """Count colours, each sample in tenths for the person and for the background."""
    for j in range(bins.shape[0]):
        for i in range(bins.shape[1]):
            if bins[j, i] >= 0:
                person[prior.bands[j], bins[j, i]] += prior.tenths[j, i]
                background[bins[j, i]] += TENTHS - prior.tenths[j, i]


@compiled
def _score(
    patch: HsvPatch,
    tables: Tables,
    grid: SampleGrid,
    prior: PersonPrior,
    boxes: F64,
    logs: F64,
    found: F64,
) -> None:
    bins = np.empty((len(grid.v), len(grid.u)), np.int32)
    for m in range(len(boxes)):
        sample_bins(patch, tables, grid, boxes[m], bins)
        total = 0.0
        for j in range(bins.shape[0]):
            for i in range(bins.shape[1]):
                if bins[j, i] >= 0:
                    total += logs[prior.bands[j], prior.tenths[j, i], bins[j, i]]
        found[m] = total * boxes[m, 2] * boxes[m, 3] / bins.size
