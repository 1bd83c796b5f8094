"""CLEAR-MOT [Bernardin 2008]."""

from dataclasses import dataclass

from common.metrics.counts import ratio
from common.metrics.frame_scores import ScoreTotals
from common.metrics.matching import Matching
from common.metrics.record import FrameMatches


@dataclass(frozen=True)
class ClearCounts(ScoreTotals):
    """Counts of CLEAR-MOT in addition to the counts of every score."""

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
        """Share of the people in view with a track."""
        return ratio(self.matches, self.truths)

    @property
    def precision(self) -> float:
        """Share of the tracks that are matched to people."""
        return ratio(self.matches, self.matches + self.false_alarms)


def count_clear(matching: Matching) -> ClearCounts:
    """Count matches and errors (docs/method.md, section 9)."""
    totals = sum((score.totals for score in matching.frame_scores), start=ScoreTotals())
    similarity = sum(_similarity(matches) for matches in matching.frame_matches)
    return ClearCounts(**vars(totals), similarity=similarity)


def _similarity(matches: FrameMatches) -> float:
    required = matches.required_pairs
    return float(matches.similarity[matches.rows[required], matches.columns[required]].sum())
