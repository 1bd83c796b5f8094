"""CLEAR-MOT [Bernardin 2008], with the trajectory counts of [Li 2009]."""

from dataclasses import dataclass, field

import numpy as np

from common.metrics.counts import Counts, ratio
from common.metrics.frame_scores import ScoreTotals
from common.metrics.matching import Matching, PersonHistory
from common.metrics.record import FrameMatches

MOSTLY_TRACKED = 0.8  # of the frames in which a person has to be tracked; more is mostly tracked
MOSTLY_LOST = 0.2  # less is mostly lost


@dataclass(frozen=True)
class ClearCounts(Counts):
    """Counts of CLEAR-MOT."""

    totals: ScoreTotals = field(default_factory=ScoreTotals)  # matches, false alarms, ID switches
    fragmentations: int = 0  # times that a person was matched again after a miss
    mostly_tracked: int = 0  # people
    partly_tracked: int = 0  # people
    mostly_lost: int = 0  # people
    similarity: float = 0.0  # sum over the matches

    @property
    def truths(self) -> int:
        """People to be tracked, over all frames."""
        return self.totals.truths

    @property
    def matches(self) -> int:
        """True positives."""
        return self.totals.matches

    @property
    def misses(self) -> int:
        """False negatives, FN."""
        return self.totals.truths - self.totals.matches

    @property
    def false_alarms(self) -> int:
        """False positives, FP."""
        return self.totals.false_alarms

    @property
    def id_switches(self) -> int:
        """Matches to another track than the person's last match."""
        return self.totals.id_switches

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
        """Share of the people to be tracked that are."""
        return ratio(self.matches, self.truths)

    @property
    def precision(self) -> float:
        """Share of the tracks that are people."""
        return ratio(self.matches, self.matches + self.false_alarms)


def count_clear(matching: Matching) -> ClearCounts:
    """Count matches and errors (docs/method.md, section 9)."""
    totals = sum((score.totals for score in matching.frame_scores), start=ScoreTotals())
    histories = matching.histories
    shares = np.array([history.matched.mean() for history in histories])
    tracked = int((shares > MOSTLY_TRACKED).sum())
    lost = int((shares < MOSTLY_LOST).sum())
    return ClearCounts(
        totals=totals,
        fragmentations=sum(_fragmentations(history) for history in histories),
        mostly_tracked=tracked,
        partly_tracked=len(histories) - tracked - lost,
        mostly_lost=lost,
        similarity=sum(_similarity(matches) for matches in matching.frame_matches),
    )


def _similarity(matches: FrameMatches) -> float:
    required = matches.required_pairs
    return float(matches.similarity[matches.rows[required], matches.columns[required]].sum())


def _fragmentations(history: PersonHistory) -> int:
    found = np.flatnonzero(history.matched)
    return int(np.count_nonzero(np.diff(found) > 1))
