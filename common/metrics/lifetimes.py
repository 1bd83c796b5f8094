"""Durations of tracks: coverage, segments, time to the first track, returns.

A tracker that drops tracks has lower errors; durations show this (docs/method.md, section 9).
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from common.metrics.counts import Counts, ratio
from common.metrics.matching import Matching, PersonHistory
from common.metrics.record import I64, Id
from people4d.messages import F64

AWAY_S = 2.0  # [s] minimum time out of view before a return


@dataclass(frozen=True)
class Lifetimes(Counts):
    """Sums over people; in view means that the person has to be tracked."""

    duration_s: float = 0.0  # [s] duration of the sequence
    truths: int = 0  # number of people in view, over all frames
    tracked: int = 0  # number of truths with a track
    measured: int = 0  # number of truths whose track has a measurement in the frame
    segments: int = 0  # number of runs of matches of one person to one track
    segments_s: float = 0.0  # [s] matched time of all segments
    people: int = 0  # number of people in view in any frame
    people_found: int = 0  # number of people with a track in any frame
    first_track_s: float = 0.0  # [s] sum of times from the first frame in view to the first match
    returns: int = 0  # number of returns of people into the view
    reidentified: int = 0  # number of returns under the same track

    @property
    def coverage(self) -> float:
        """Share of the people in view with a track."""
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
        """Mean time to the first track of all people with a track; None if there are none."""
        return self.first_track_s / self.people_found if self.people_found else None

    @property
    def share_reidentified(self) -> float | None:
        """Share of the returns under the same track; None if there were no returns."""
        return self.reidentified / self.returns if self.returns else None


def count_lifetimes(matching: Matching) -> Lifetimes:
    """Measure the durations for which people are tracked.

    A segment is a run of a person's matches to one track, ended by another track. Frames missed in
    between do not end it, and do not lengthen it.
    """
    periods_s, stamps_s = matching.sequence.periods_s, matching.sequence.stamps_s
    views = _frames_in_view(matching)
    total = Lifetimes(duration_s=float(periods_s.sum()))
    for history in matching.histories:
        returns = list(_returns(history, views[history.person], matching))
        total += _lifetime(history, periods_s, stamps_s)
        total += Lifetimes(returns=len(returns), reidentified=sum(returns))
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
        people_found=int(found),
        first_track_s=first_s,
    )


def _returns(history: PersonHistory, view: I64, matching: Matching) -> Iterator[bool]:
    """Yield for each return of a tracked person True if the track is the same.

    The person was out of view for at least AWAY_S, and has to be tracked after the return. The most
    frequent track of the visit counts.
    """
    leaves = np.flatnonzero(np.diff(matching.sequence.stamps_s[view]) >= AWAY_S)
    backs = view[leaves + 1]  # first frame of each visit but the first
    ends = np.append(backs, len(matching.frame_matches))[1:]
    for back, end in zip(backs, ends, strict=True):
        known = history.tracks[(history.frames < back) & history.matched]
        visit = history.tracks[(history.frames >= back) & (history.frames < end)]
        if len(known) and len(visit):
            tracked = visit[visit >= 0]
            yield bool(len(tracked) and np.bincount(tracked).argmax() == known[-1])


def _frames_in_view(matching: Matching) -> dict[Id, I64]:
    views: defaultdict[Id, list[int]] = defaultdict(list)
    for index, frame in enumerate(matching.sequence.frames):
        for person, in_view in zip(frame.truth.ids, frame.truth.in_view, strict=True):
            if in_view:
                views[person].append(index)
    return {person: np.array(frames) for person, frames in views.items()}
