"""Differences between two methods with 95 % intervals: a paired bootstrap over scenes or events."""

from dataclasses import dataclass

import numpy as np

from people4d.messages import F64

ROUNDS = 2000  # number of resamples
SEED = 1


@dataclass(frozen=True)
class PooledFigure:
    """A pooled figure: a sum over a sum, such as squared errors over matches."""

    title: str
    form: str = "{:.3f}"
    factor: float = 1.0
    root: bool = False  # True: root of the ratio
    higher_is_better: bool = False


@dataclass(frozen=True)
class Difference:
    """Difference of one figure of a method from the reference."""

    figure: PooledFigure
    value: float
    low: float
    high: float

    @property
    def is_worse(self) -> bool:
        """True if the interval lies on the side of worse values."""
        return self.high < 0 if self.figure.higher_is_better else self.low > 0

    @property
    def is_better(self) -> bool:
        """True if the interval lies on the side of better values."""
        return self.low > 0 if self.figure.higher_is_better else self.high < 0

    def __str__(self) -> str:
        """Return value and interval; bold if the interval excludes 0."""
        value, low, high = (
            self.figure.form.replace("{:", "{:+").format(x)
            for x in (self.value, self.low, self.high)
        )
        shown = f"{value} [{low}, {high}]"
        return f"**{shown}**" if self.is_worse or self.is_better else shown


def pool(sums: F64, figures: tuple[PooledFigure, ...]) -> F64:
    """Return the figures (...xF) of sums (...xFx2: part and total); NaN if a total is 0."""
    parts, totals = sums[..., 0], sums[..., 1]
    ratios = np.divide(parts, totals, out=np.full(parts.shape, np.nan), where=totals > 0)
    roots = np.array([figure.root for figure in figures])
    factors = np.array([figure.factor for figure in figures])
    return np.asarray(factors * np.where(roots, np.sqrt(ratios), ratios))


def compare(method: F64, reference: F64, figures: tuple[PooledFigure, ...]) -> list[Difference]:
    """Return the difference of each figure between two methods on the same units.

    Args:
        method: Sums of each unit, NxFx2. Units, scenes or events, are resampled as a whole.
        reference: Sums of the reference on the same units in the same order.
        figures: The F figures.

    Source: percentile bootstrap [Efron 1979], paired by unit.
    """
    count = len(method)
    drawn = np.random.default_rng(SEED).multinomial(count, np.full(count, 1 / count), ROUNDS)

    def difference(weights: F64) -> F64:
        pooled = (pool(np.tensordot(weights, sums, 1), figures) for sums in (method, reference))
        first, second = pooled
        return first - second

    values = difference(np.ones(count))
    low, high = np.nanpercentile(difference(drawn.astype(np.float64)), (2.5, 97.5), axis=0)
    limits = zip(figures, values.tolist(), low.tolist(), high.tolist(), strict=True)
    return [Difference(*one) for one in limits]
