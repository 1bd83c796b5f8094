"""Counts that add up over sequences."""

from dataclasses import fields
from typing import Self

import numpy as np

from people4d.messages import F64


class Counts:
    """Base of records of sums: adding two adds each field."""

    def __add__(self, other: Self) -> Self:
        names = [field.name for field in fields(self)]  # type: ignore[arg-type]
        return type(self)(*(getattr(self, name) + getattr(other, name) for name in names))


def ratio(part: float, whole: float) -> float:
    """Divide; 0 where there is nothing to divide by, as TrackEval has it."""
    return float(part / whole) if whole else 0.0


def ratios(part: F64, whole: F64) -> F64:
    """Divide elementwise; 0 where there is nothing to divide by."""
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)
