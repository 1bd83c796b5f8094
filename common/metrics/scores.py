"""All metrics of one sequence, or of several together."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import TypeAlias

import numpy as np

from common.metrics.clear import ClearCounts, count_clear
from common.metrics.counts import Counts, ratio
from common.metrics.hota import HotaCounts, count_hota
from common.metrics.identity import IdentityCounts, count_identity
from common.metrics.lifetimes import Lifetimes, count_lifetimes
from common.metrics.matching import Matching, match
from common.metrics.pose import PoseErrors, pool
from common.metrics.record import EvaluationSequence
from common.metrics.similarity import Similarity

Row: TypeAlias = dict[str, float | None]


# Figures of a row, in its order
CLEAR = ("mota", "motp", "recall", "precision", "truths", "misses", "false_alarms", "id_switches")
IDENTITY = ("idf1", "idp", "idr")
HOTA = ("hota", "det_a", "ass_a")
LIFETIMES = (
    *("duration_s", "coverage", "coverage_measured", "mean_segment_s", "mean_first_track_s"),
    *("people", "people_found", "returns", "share_reidentified"),
)


@dataclass(frozen=True)
class Scores(Counts):
    """Counts and sums from which every metric follows; adding two pools their sequences."""

    clear: ClearCounts
    identity: IdentityCounts
    hota: HotaCounts
    lifetimes: Lifetimes
    errors: PoseErrors  # errors of all matches in view, including occluded people

    @property
    def pose(self) -> PoseErrors:
        """Errors on people to be tracked."""
        return self.errors.select(~self.errors.occluded)

    @property
    def pose_parts(self) -> dict[str, PoseErrors]:
        """Errors of measured and of predicted tracks, and errors on occluded people in view."""
        occluded, predicted = self.errors.occluded, self.errors.predicted
        return {
            "measured": self.errors.select(~occluded & ~predicted),
            "predicted": self.errors.select(~occluded & predicted),
            "occluded": self.errors.select(occluded),
        }

    @property
    def id_switches_per_min(self) -> float:
        """ID switches over the duration [1/min]; 0 for a duration of 0."""
        return ratio(self.clear.id_switches, self.lifetimes.duration_s / 60.0)

    def row(self) -> Row:
        """Return all metrics by name, units in the name, shares 0 to 1; None where undefined."""
        row: Row = {name: getattr(self.clear, name) for name in CLEAR}
        row["id_switches_per_min"] = self.id_switches_per_min
        row |= {name: getattr(self.identity, name) for name in IDENTITY}
        row |= {name: float(getattr(self.hota, name).mean()) for name in HOTA}
        row |= {name: getattr(self.lifetimes, name) for name in LIFETIMES}
        return row | self.pose.row()


def score(sequence: EvaluationSequence, similarity: Similarity, threshold: float = 0.5) -> Scores:
    """Return all counts of a sequence (docs/method.md, section 9).

    Args:
        sequence: Truth and tracks.
        similarity: Similarity of people and tracks, for example `GroundDistance(1.0)`.
        threshold: Minimum similarity of a match.
    """
    return score_matching(match(sequence, similarity, threshold))


def score_matching(matching: Matching) -> Scores:
    """Score a matched sequence."""
    return Scores(
        count_clear(matching),
        count_identity(matching),
        count_hota(matching),
        count_lifetimes(matching),
        pool([frame.errors for frame in matching.frame_scores]),
    )


def combine(scores: Iterable[Scores]) -> Scores:
    """Pool sequences: counts and errors are summed before ratios are computed."""
    empty = Scores(ClearCounts(), IdentityCounts(), HotaCounts(), Lifetimes(), pool([]))
    return reduce(add, scores, empty)


@dataclass(frozen=True)
class SummaryStatistics:
    """One figure over several runs."""

    mean: float
    std: float  # sample standard deviation (n - 1); 0 for a single run
    least: float
    most: float
    runs: int  # number of runs with a defined figure


def summarise(rows: Sequence[Row]) -> dict[str, SummaryStatistics | None]:
    """Summarise each figure over runs (rows of `Scores.row`); None if undefined in all."""
    summary: dict[str, SummaryStatistics | None] = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        known = np.array([row[name] for row in rows if row.get(name) is not None], np.float64)
        std = float(known.std(ddof=1)) if len(known) > 1 else 0.0
        summary[name] = (
            SummaryStatistics(known.mean(), std, known.min(), known.max(), len(known))
            if len(known)
            else None
        )
    return summary
