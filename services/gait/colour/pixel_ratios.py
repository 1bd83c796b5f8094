"""How much likelier a box's pixels are a person's than what is about them.

A histogram of all of a box does not tell a person from half of a person, nor from a shelf of the
same colours. Here each pixel counts by where it is: by how much of that place in a box people fill,
what colours the person has at that height, and what colours there are about them just now.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from people4d.messages import F64, U8
from services.gait.colour.config import ColourLayerConfig
from services.gait.colour.histogram import I32, HueSaturation, Part

# How likely a pixel of a box is the person's, 1/10: most in the middle, less towards the sides; the
# head is half as wide as the rest.
SURE, HEAD = 8.0, 0.15  # in the middle; the head's share of the height
HEAD_WIDE, BODY_WIDE = 0.2, 0.4  # where it falls to 1/e, from the middle, in widths of the box
TENTHS = 10
LEARN = (32, 72)  # points in and about a box that colours are learnt from
UNSEEN = 3e-4  # share that a colour which was not seen is taken to have
RATIO_MAX = 10.0  # one pixel says no more


@dataclass(frozen=True)
class Colours:
    """What colours a person has, and what is about them; rows sum to 1."""

    person: F64  # bands x bins, from the top down
    around: F64  # bins

    @cached_property
    def ratios(self) -> F64:
        """How much likelier the person has a colour than what is about them, bands x bins."""
        ratios = (self.person + UNSEEN) / (self.around + UNSEEN)
        return np.asarray(np.clip(ratios, 1 / RATIO_MAX, RATIO_MAX))


class Grid(NamedTuple):
    """Points at which boxes are looked at."""

    u: F64  # columns, in widths of the box from its middle
    v: F64  # rows, in heights
    bands: npt.NDArray[np.int64]  # of the rows
    tenths: I32  # rows x columns: how likely the point is the person's; 0 outside of the box


def grid_of(points: tuple[int, int], sides: tuple[float, float], bands: int) -> Grid:
    """Return points, each in the middle of its cell.

    Args:
        points: Across and down.
        sides: Of what is looked at, in those of the box.
        bands: Into which the box's height is divided.
    """
    u, v = (
        side * ((np.arange(count) + 0.5) / count - 0.5)
        for count, side in zip(points, sides, strict=True)
    )
    height = v + 0.5
    wide = np.where(height < HEAD, HEAD_WIDE, BODY_WIDE)[:, None]
    inside = (np.abs(u) < 0.5) & (np.abs(v) < 0.5)[:, None]
    tenths = np.where(inside, np.rint(SURE * np.exp(-((u / wide) ** 4))), 0).astype(np.int32)
    return Grid(u, v, np.clip(height * bands, 0, bands - 1).astype(np.int64), tenths)


class PixelRatios:
    """Learns what colours people have, and tells how well boxes fit them.

    Args:
        config: Points, bands, and how far about a box is looked.
        bins: Of hue and saturation.
    """

    def __init__(self, config: ColourLayerConfig, bins: HueSaturation) -> None:
        self._bins, self._bands = bins, config.bands
        sides = config.around, (1 + config.around) / 2
        self.reach = np.array([1.0, 1.0, *sides])  # of a box that is learnt from
        self._points = grid_of(config.points, (1.0, 1.0), config.bands)
        self._learnt = grid_of(LEARN, sides, config.bands)

    def learn(self, part: Part, box: F64) -> Colours:
        """Return the colours of the person in a box, and those about them.

        Each point counts for the person as far as it is likely theirs by its place, and for what is
        about them as far as it is not.

        Args:
            part: Of the image, covers the box times `reach`.
            box: [px] 4: centre x, y, width, height.
        """
        person, around = np.zeros((self._bands, self._bins.bins)), np.zeros(self._bins.bins)
        where = part.left, part.top
        _share(part.hsv, where, *self._bins.tables, self._learnt, box, person, around)
        return Colours(_normalised(person), _normalised(around))

    def scores(self, part: Part, boxes: F64, colours: Colours) -> F64:
        """Return how much likelier boxes are the person than what is about them.

        Args:
            part: Of the image, covers the boxes.
            boxes: [px] Mx4: centre x, y, width, height.
            colours: Of the person.

        Returns:
            M, logarithms, summed over the pixels of each box.
        """
        tenths = np.arange(TENTHS)[:, None] / TENTHS
        logs = np.log1p(tenths * (colours.ratios[:, None] - 1))
        found = np.empty(len(boxes))
        where = part.left, part.top
        _score(part.hsv, where, *self._bins.tables, self._points, boxes, logs, found)
        return found


def _normalised(counts: F64) -> F64:
    return np.asarray(counts / np.maximum(counts.sum(axis=-1, keepdims=True), 1e-9))


@compiled
def _share(
    hsv: U8,
    where: tuple[int, int],
    hue: I32,
    saturation: I32,
    grid: Grid,
    box: F64,
    person: F64,
    around: F64,
) -> None:
    """Count colours, each point in tenths of the person and of what is about them."""
    height, width = hsv.shape[:2]
    for j in range(len(grid.v)):
        row = math.floor(box[1] + box[3] * grid.v[j]) - where[1]
        if row < 0 or row >= height:
            continue
        band = grid.bands[j]
        for i in range(len(grid.u)):
            column = math.floor(box[0] + box[2] * grid.u[i]) - where[0]
            if 0 <= column < width:
                colour = hue[hsv[row, column, 0]] + saturation[hsv[row, column, 1]]
                person[band, colour] += grid.tenths[j, i]
                around[colour] += TENTHS - grid.tenths[j, i]


@compiled
def _score(
    hsv: U8,
    where: tuple[int, int],
    hue: I32,
    saturation: I32,
    grid: Grid,
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
            row = math.floor(y + high * grid.v[j]) - where[1]
            if row < 0 or row >= height:
                continue
            band = grid.bands[j]
            for i in range(len(grid.u)):
                column = math.floor(x + wide * grid.u[i]) - where[0]
                if 0 <= column < width:
                    colour = hue[hsv[row, column, 0]] + saturation[hsv[row, column, 1]]
                    total += logs[band, grid.tenths[j, i], colour]
        found[m] = total * wide * high / cells
