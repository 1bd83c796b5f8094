"""Smooth noise, a pure function of image position and time.

The knots of a grid are independent standard normal numbers; between two knots a and b the value is
a cos(t) + b sin(t), t from 0 to pi/2. This is continuous with variance 1 everywhere, while linear
interpolation has less variance between the knots. The same blends grids in time. Frames have no
state, and may be computed in any order.
"""

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from common.compiled import compiled
from people4d.messages import F32

FROZEN = 0  # key of the constant part
RUNNING = 1  # key of the part that changes from knot to knot
CACHED_KNOTS = 3  # maximum number of cached knots of one process; neighbouring frames share them


def blend(position: float) -> tuple[int, float, float]:
    """Return the knot before a position and the weights of that knot and of the next."""
    knot = math.floor(position)
    angle = (position - knot) * math.pi / 2
    return knot, math.cos(angle), math.sin(angle)


@dataclass(frozen=True, kw_only=True)
class Persistence:
    """Duration of noise."""

    frozen_share: float  # constant share of the variance, 0 to 1
    # interval of the knots of the other part: its correlation is 1/pi after one interval and 0
    # after two
    correlation_s: float


class NoiseProcess:
    """An array of independent normal numbers, variance 1, that change with time."""

    def __init__(
        self, shape: tuple[int, ...], seed: tuple[int, ...], persistence: Persistence
    ) -> None:
        self._shape = shape
        self._seed = seed
        self._persistence = persistence
        self._frozen = self._draw(FROZEN, 0)
        self._knots: dict[int, F32] = {}

    def at(self, time_s: float) -> F32:
        """Return the array at a time."""
        frozen = self._persistence.frozen_share
        knot, before, after = blend(time_s / self._persistence.correlation_s)
        running = math.sqrt(1 - frozen)
        values: F32 = np.float32(running * before) * self._knot(knot)
        values += np.float32(running * after) * self._knot(knot + 1)
        values += np.float32(math.sqrt(frozen)) * self._frozen
        return values

    def _knot(self, knot: int) -> F32:
        """Return the numbers of a knot; the nearest are cached, since drawing is slow."""
        values = self._knots.get(knot)
        if values is None:
            values = self._draw(RUNNING, knot % 2**64)
            nearest = sorted(self._knots.items(), key=lambda item: abs(item[0] - knot))
            self._knots = {**dict(nearest[: CACHED_KNOTS - 1]), knot: values}
        return values

    def _draw(self, part: int, knot: int) -> F32:
        generator = np.random.default_rng([*self._seed, part, knot])
        return generator.standard_normal(self._shape, np.float32)


class NoiseField:
    """Noise over the image, variance 1.

    Args:
        shape: Height and width of the image.
        cell_px: Distance of the knots in the image; 1: independent pixels.
        seed: Numbers that identify this noise.
        persistence: Duration of the noise.
    """

    def __init__(
        self, shape: tuple[int, int], cell_px: int, seed: tuple[int, ...], persistence: Persistence
    ) -> None:
        grid = shape if cell_px == 1 else (shape[0] // cell_px + 2, shape[1] // cell_px + 2)
        self._shape = shape
        self._cell_px = cell_px
        self._drift = NoiseProcess(grid, seed, persistence)
        steps = [blend(step / cell_px)[1:] for step in range(cell_px)]
        self._weights: F32 = np.array(steps, np.float32)

    def at(self, time_s: float) -> F32:
        """Return the noise of each pixel at a time, HxW."""
        grid = self._drift.at(time_s)
        if self._cell_px == 1:
            return grid
        image: F32 = np.empty(self._shape, np.float32)
        _spread(grid, self._weights, image)
        return image


@compiled
def _spread(grid: F32, weights: F32, image: F32) -> None:
    """Fill an image from the knots; row i of the weights belongs to the i-th pixel of a cell."""
    cell, width = len(weights), image.shape[1]
    row = np.empty(grid.shape[1], np.float32)
    for v in range(image.shape[0]):
        above, within = v // cell, weights[v % cell]
        for k in range(len(row)):
            row[k] = within[0] * grid[above, k] + within[1] * grid[above + 1, k]
        for left in range(len(row) - 1):
            for u in range(left * cell, min((left + 1) * cell, width)):
                across = weights[u - left * cell]
                image[v, u] = across[0] * row[left] + across[1] * row[left + 1]


def threshold(share: float) -> float:
    """Return the value that standard normal noise exceeds with a probability of `share`."""
    return math.inf if share <= 0 else NormalDist().inv_cdf(max(1 - share, 1e-9))
