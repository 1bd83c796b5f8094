"""CLEAR-MOT [Bernardin 2008], with the trajectory counts of [Li 2009]."""

from dataclasses import dataclass

import numpy as np

from common.metrics.counts import ratio
from common.metrics.frame_scores import ScoreTotals
from common.metrics.matching import Matching
from common.metrics.record import FrameMatches

MOSTLY_TRACKED = 0.8  # share of the frames with a track above which a person is mostly tracked
MOSTLY_LOST = 0.2  # share of these frames below which a person is mostly lost


@dataclass(frozen=True)
class ClearCounts(ScoreTotals):
    """Counts of CLEAR-MOT in addition to the counts of every score."""

    fragmentations: int = 0  # matches of a person after a miss
    mostly_tracked: int = 0  # number of people
    partly_tracked: int = 0  # number of people
    mostly_lost: int = 0  # number of people
    similarity: float = 0.0  # sum over all matches

    @property
    def misses(self) -> int:
        """False negatives, FN."""
        return self.truths - self.matches

    @property
    def mota(self) -> float:
        """1 - (FN + FP + IDsw) / truths; negative if there are more errors than people."""
        errors = self.misses + self.false_alarms + self.id_switches
        return ratio(self.truths - errors, self.truths)

    @property
    def motp(self) -> float:
        """Mean similarity of the matches."""
        return ratio(self.similarity, self.matches)

    @property
    def recall(self) -> float:
        """Share of the people in view who have a track."""
        return ratio(self.matches, self.truths)

    @property
    def precision(self) -> float:
        """Share of the tracks that are matched to people."""
        return ratio(self.matches, self.matches + self.false_alarms)


def count_clear(matching: Matching) -> ClearCounts:
    """Count matches and errors (docs/method.md, section 9)."""
    totals = sum((score.totals for score in matching.frame_scores), start=ScoreTotals())
    matched = [history.matched for history in matching.histories]
    shares = np.array([frames.mean() for frames in matched])
    tracked = int((shares > MOSTLY_TRACKED).sum())
    lost = int((shares < MOSTLY_LOST).sum())
    return ClearCounts(
        **vars(totals),
        fragmentations=sum(int((np.diff(np.flatnonzero(f)) > 1).sum()) for f in matched),
        mostly_tracked=tracked,
        partly_tracked=len(matched) - tracked - lost,
        mostly_lost=lost,
        similarity=sum(_similarity(matches) for matches in matching.frame_matches),
    )


def _similarity(matches: FrameMatches) -> float:
    required = matches.required_pairs
    return float(matches.similarity[matches.rows[required], matches.columns[required]].sum())
