"""95 % intervals of figures by the jackknife, and exact ones of rates."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.stats import chi2
from scipy.stats import t as student

UNITS_MIN = 3  # minimum number of units of an interval

Interval = tuple[float, float, float]  # value, low, high; NaN without an interval


def jackknife(
    figures: Callable[[Sequence[int]], Mapping[str, float | None]], units: int
) -> dict[str, Interval]:
    """Return the defined figures over some units with their intervals.

    Args:
        figures: Figures over the units with some numbers, which need be no sums of units.
        units: Number of units, such as blocks of time or scenes.

    Source: delete-one jackknife [Efron 1979], with Student's t for few units.
    """
    together = {k: float(x) for k, x in figures(range(units)).items() if x is not None}
    if units < UNITS_MIN:
        return {name: (value, np.nan, np.nan) for name, value in together.items()}
    parts = [figures([u for u in range(units) if u != left]) for left in range(units)]
    found = {}
    for name, value in together.items():
        known = np.array([x for part in parts if (x := part[name]) is not None], np.float64)
        sigma = np.sqrt((len(known) - 1) * known.var())
        half = float(student.ppf(0.975, max(1, len(known) - 1)) * sigma)
        found[name] = value, value - half, value + half
    return found


def poisson_rate(count: int, hours: float) -> Interval:
    """Return the rate of a count with its exact interval of a Poisson process [1/h]."""
    low = float(chi2.ppf(0.025, 2 * count)) / 2 if count else 0.0
    high = float(chi2.ppf(0.975, 2 * count + 2)) / 2
    return count / hours, low / hours, high / hours
