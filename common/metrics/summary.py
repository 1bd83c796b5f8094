"""Mean and spread of figures over repetitions, for example over random seeds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SummaryStatistics:
    """One figure over several runs."""

    mean: float
    std: float  # of the sample (n - 1); 0 for a single run
    least: float
    most: float
    runs: int  # in which the figure was defined


def summarise(rows: Sequence[Mapping[str, float | None]]) -> dict[str, SummaryStatistics | None]:
    """Summarise each figure over the runs that have it.

    Args:
        rows: One table row for each run, as `Scores.row` gives them.

    Returns:
        Mean and spread of every figure; None where no run has it.
    """
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: _spread([row.get(name) for row in rows]) for name in names}


def _spread(values: Sequence[float | None]) -> SummaryStatistics | None:
    known = np.array([value for value in values if value is not None], np.float64)
    if not len(known):
        return None
    std = float(known.std(ddof=1)) if len(known) > 1 else 0.0
    return SummaryStatistics(
        float(known.mean()), std, float(known.min()), float(known.max()), len(known)
    )
