"""Durations of tracks: coverage, segments, time to the first track, returns.

A tracker that drops tracks has small errors; these metrics show it (docs/method.md, section 9).
"""

from dataclasses import dataclass

import numpy as np

from common.metrics.counts import Counts, ratio
from common.metrics.matching import Matching, PersonHistory
from common.metrics.returns import find_returns
from people4d.messages import F64


@dataclass(frozen=True)
class Lifetimes(Counts):
    """Sums over people; in view means that the person has to be tracked."""

    duration_s: float = 0.0  # [s] of the sequence
    truths: int = 0  # people in view, over all frames
    tracked: int = 0  # of them with a track
    measured: int = 0  # of them with a track that has a measurement in the frame
    segments: int = 0  # runs of matches of one person to one track
    segments_s: float = 0.0  # [s] matched in them
    people: int = 0  # who were in view at all
    found: int = 0  # of them who got a track
    first_track_s: float = 0.0  # [s] from the first frame in view to the first match, over found
    returns: int = 0  # times that a person came back into the view
    reidentified: int = 0  # of them under the same track

    @property
    def coverage(self) -> float:
        """Share of the people in view that have a track."""
        return ratio(self.tracked, self.truths)

    @property
    def coverage_measured(self) -> float:
        """Share of the people in view whose track has a measurement in the frame."""
        return ratio(self.measured, self.truths)

    @property
    def mean_segment_s(self) -> float | None:
        """Mean duration of a segment; None if there is none."""
        return self.segments_s / self.segments if self.segments else None

    @property
    def mean_first_track_s(self) -> float | None:
        """Mean time to the first track of those who got one; None if none did."""
        return self.first_track_s / self.found if self.found else None

    @property
    def share_reidentified(self) -> float | None:
        """Share of the returns under the same track; None if none came back."""
        return self.reidentified / self.returns if self.returns else None


def count_lifetimes(matching: Matching) -> Lifetimes:
    """Measure how long people are tracked.

    A segment is a run of a person's matches to one track, ended by another track. Frames missed in
    between do not end it, and do not lengthen it.
    """
    periods_s, stamps_s = matching.sequence.periods_s, matching.sequence.stamps_s
    back = find_returns(matching)
    total = Lifetimes(
        duration_s=float(periods_s.sum()),
        returns=len(back),
        reidentified=sum(one.reidentified for one in back),
    )
    for history in matching.histories:
        total += _lifetime(history, periods_s, stamps_s)
    return total


def _lifetime(history: PersonHistory, periods_s: F64, stamps_s: F64) -> Lifetimes:
    frames, tracks = history.frames[history.matched], history.tracks[history.matched]
    found = len(frames) > 0
    first_s = float(stamps_s[frames[0]] - stamps_s[history.frames[0]]) if found else 0.0
    return Lifetimes(
        truths=len(history.frames),
        tracked=len(frames),
        measured=int(history.measured.sum()),
        segments=int(np.count_nonzero(np.diff(tracks))) + found,
        segments_s=float(periods_s[frames].sum()),
        people=1,
        found=int(found),
        first_track_s=first_s,
    )
