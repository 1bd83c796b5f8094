"""Counts that are summed over sequences."""

from dataclasses import fields
from typing import Self

import numpy as np

from people4d.messages import F64


class Counts:
    """Base of records of sums: adding two adds each field."""

    def __add__(self, other: Self) -> Self:
        names = [field.name for field in fields(self)]  # type: ignore[arg-type]
        return type(self)(*(getattr(self, name) + getattr(other, name) for name in names))


def ratio(part: float, total: float) -> float:
    """Divide; 0 if the divisor is 0, as in TrackEval."""
    return float(part / total) if total else 0.0


def ratios(part: F64, total: F64) -> F64:
    """Divide elementwise; 0 where the divisor is 0."""
    return np.divide(part, total, out=np.zeros_like(part), where=total > 0)
