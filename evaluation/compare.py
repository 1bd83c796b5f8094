"""Comparison of two reports of people4d evaluate on the same ground truth."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.metrics.intervals import Difference, compare, pool
from evaluation import protocol
from evaluation.protocol import read_protocol
from evaluation.report import parts
from evaluation.report.parts import FIGURES, read_parts
from people4d.errors import SourceError
from people4d.messages import F64

UNITS_MIN = 4  # minimum number of parts of an interval


@dataclass(frozen=True)
class ComparedFigure:
    """One figure of two runs, and the difference of the second from the first."""

    first: float
    second: float
    difference: Difference
    parts: int  # number of parts that were resampled

    @property
    def half(self) -> float:
        """Half width of the 95 % interval, by its longer side."""
        return max(
            self.difference.high - self.difference.value,
            self.difference.value - self.difference.low,
        )

    @property
    def gain(self) -> float:
        """Difference, positive if the second run is better."""
        value = self.difference.value
        return value if self.difference.figure.higher_is_better else -value

    @property
    def is_better(self) -> bool:
        """True if the second run is better beyond the interval."""
        return self.parts >= UNITS_MIN and self.gain > self.half

    @property
    def is_worse(self) -> bool:
        """True if the second run is worse beyond the interval."""
        return self.parts >= UNITS_MIN and -self.gain > self.half

    @property
    def sentence(self) -> str:
        """Statement with the interval."""
        form, value = self.difference.figure.form.format, self.difference.value
        if self.parts < UNITS_MIN:
            return f"no interval from {self.parts} parts"
        if self.is_better or self.is_worse:
            sense = "better" if self.is_better else "worse"
            return f"{sense} by {form(abs(value))} ± {form(self.half)}"
        return f"no difference beyond the interval ({form(value)} ± {form(self.half)})"


def compare_sums(first: F64, second: F64) -> Iterator[ComparedFigure]:
    """Yield the figures that both runs have, from the sums of the same parts (NxFx2)."""
    before, after = (pool(sums.sum(axis=0), FIGURES) for sums in (first, second))
    known = np.isfinite(before) & np.isfinite(after)
    chosen = tuple(figure for figure, one in zip(FIGURES, known, strict=True) if one)
    differences = compare(second[:, known], first[:, known], chosen)
    for one in zip(before[known].tolist(), after[known].tolist(), differences, strict=True):
        yield ComparedFigure(*one, parts=len(first))


def compare_reports(first: Path, second: Path) -> dict[tuple[str, str], list[ComparedFigure]]:
    """Compare the methods of two reports: each under its name, or the only ones.

    SourceError if a report is incomplete, the ground truth differs, or no method is common.
    """
    _check_truth(first, second)
    runs = [read_parts(folder / parts.FILE) for folder in (first, second)]
    names = [list(dict.fromkeys(method for method, _ in found)) for found in runs]
    pairs = [(name, name) for name in names[0] if name in names[1]]
    if len(names[0]) == len(names[1]) == 1:
        pairs = [(names[0][0], names[1][0])]
    if not pairs:
        raise SourceError(
            f"{first} and {second} have no method in common: {', '.join(names[0])} against "
            f"{', '.join(names[1])}",
            "Compare reports of one method each, or of the same methods.",
        )
    found = {}
    for pair in pairs:
        sums = [
            np.concatenate([sums for (method, _), sums in sorted(run.items()) if method == name])
            for run, name in zip(runs, pair, strict=True)
        ]
        if len(sums[0]) != len(sums[1]):
            raise SourceError(
                f"{first} and {second} have {len(sums[0])} and {len(sums[1])} parts of {pair[0]}",
                f"A {parts.FILE} is incomplete: evaluate again.",
            )
        found[pair] = list(compare_sums(*sums))
    return found


def _check_truth(first: Path, second: Path) -> None:
    truths = [read_protocol(folder / protocol.FILE).recordings for folder in (first, second)]
    for name in sorted(truths[0].keys() | truths[1].keys()):
        one, other = (truth[name].truth if name in truth else "none" for truth in truths)
        if one != other:
            raise SourceError(
                f"{first} and {second} have different ground truth of {name}: {one}, {other}",
                "Evaluate both on the same recordings and ground truth.",
            )
