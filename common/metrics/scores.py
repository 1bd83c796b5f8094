"""All metrics of one sequence, or of several together."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import TypeAlias

import numpy as np

from common.metrics.clear import ClearCounts, count_clear
from common.metrics.counts import ratio
from common.metrics.hota import HotaCounts, count_hota
from common.metrics.identity import IdentityCounts, count_identity
from common.metrics.lifetimes import Lifetimes, count_lifetimes
from common.metrics.matching import Matching, match
from common.metrics.pose import PoseErrors, pool
from common.metrics.record import EvaluationSequence
from common.metrics.similarity import Similarity

Row: TypeAlias = dict[str, float | None]


@dataclass(frozen=True)
class Scores:
    """Counts and sums from which every metric follows; adding two pools their sequences."""

    clear: ClearCounts
    identity: IdentityCounts
    hota: HotaCounts
    lifetimes: Lifetimes
    errors: PoseErrors  # of all matches in view, the occluded too

    def __add__(self, other: "Scores") -> "Scores":
        """Pool the sequences of both."""
        return Scores(
            self.clear + other.clear,
            self.identity + other.identity,
            self.hota + other.hota,
            self.lifetimes + other.lifetimes,
            self.errors + other.errors,
        )

    @property
    def pose(self) -> PoseErrors:
        """Errors on the people who have to be tracked."""
        return self.errors.select(~self.errors.occluded)

    @property
    def pose_measured(self) -> PoseErrors:
        """Of these, errors of tracks with a measurement in the frame."""
        return self.errors.select(~self.errors.occluded & ~self.errors.predicted)

    @property
    def pose_predicted(self) -> PoseErrors:
        """Of these, errors of tracks that were predicted."""
        return self.errors.select(~self.errors.occluded & self.errors.predicted)

    @property
    def pose_occluded(self) -> PoseErrors:
        """Errors on the people in view, but occluded."""
        return self.errors.select(self.errors.occluded)

    @property
    def id_switches_per_min(self) -> float:
        """ID switches over the duration; 0 if nothing lasts."""
        return ratio(self.clear.id_switches, self.lifetimes.duration_s / 60.0)

    def row(self) -> Row:
        """Return all metrics by name, units in the name, shares 0 to 1; None where undefined."""
        return self._clear_row() | self._identity_row() | self._life_row() | self.pose.row()

    def _clear_row(self) -> Row:
        c = self.clear
        return {
            "mota": c.mota,
            "motp": c.motp,
            "recall": c.recall,
            "precision": c.precision,
            "truths": c.truths,
            "misses": c.misses,
            "false_alarms": c.false_alarms,
            "id_switches": c.id_switches,
            "id_switches_per_min": self.id_switches_per_min,
            "fragmentations": c.fragmentations,
            "mostly_tracked": c.mostly_tracked,
            "partly_tracked": c.partly_tracked,
            "mostly_lost": c.mostly_lost,
        }

    def _identity_row(self) -> Row:
        means = {
            name: float(getattr(self.hota, name).mean())
            for name in ("hota", "det_a", "ass_a", "loc_a", "det_re", "det_pr", "ass_re", "ass_pr")
        }
        i = self.identity
        return {"idf1": i.idf1, "idp": i.idp, "idr": i.idr, **means}

    def _life_row(self) -> Row:
        life = self.lifetimes
        return {
            "duration_s": life.duration_s,
            "coverage": life.coverage,
            "coverage_measured": life.coverage_measured,
            "mean_segment_s": life.mean_segment_s,
            "mean_first_track_s": life.mean_first_track_s,
            "people": life.people,
            "people_found": life.found,
            "returns": life.returns,
            "share_reidentified": life.share_reidentified,
        }


def score(sequence: EvaluationSequence, similarity: Similarity, threshold: float = 0.5) -> Scores:
    """Score one sequence.

    Args:
        sequence: Truth and tracks.
        similarity: Similarity of people and tracks, for example `GroundDistance(1.0)`.
        threshold: Least similarity of a match.

    Returns:
        All counts of docs/method.md, section 9.
    """
    return score_matching(match(sequence, similarity, threshold))


def score_matching(matching: Matching) -> Scores:
    """Score a sequence that is matched already."""
    return Scores(
        count_clear(matching),
        count_identity(matching),
        count_hota(matching),
        count_lifetimes(matching),
        pool([frame.errors for frame in matching.frame_scores]),
    )


def combine(scores: Iterable[Scores]) -> Scores:
    """Pool sequences: counts and errors are put together before any ratio is taken."""
    empty = Scores(ClearCounts(), IdentityCounts(), HotaCounts(), Lifetimes(), pool([]))
    return reduce(add, scores, empty)


@dataclass(frozen=True)
class SummaryStatistics:
    """One figure over several runs."""

    mean: float
    std: float  # of the sample (n - 1); 0 for a single run
    least: float
    most: float
    runs: int  # in which the figure was defined


def summarise(rows: Sequence[Row]) -> dict[str, SummaryStatistics | None]:
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
