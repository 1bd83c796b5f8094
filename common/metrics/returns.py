"""Re-identification of people who left the view and returned."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from common.metrics.matching import Matching, PersonHistory
from common.metrics.record import I64, Id

AWAY_S = 2.0  # [s] out of the view for a shorter time is no leaving


@dataclass(frozen=True)
class ReturnToView:
    """One person who left the view with a track and came back."""

    person: Id
    frame: int  # index of the frame in which they were back
    away_s: float  # [s] from the last frame in view to that frame
    before: Id  # their last track before leaving
    after: Id | None  # the track they had for the most frames of the next visit; None: never found

    @property
    def reidentified(self) -> bool:
        """True if the track is the same."""
        return self.after == self.before


def find_returns(matching: Matching, away_s: float = AWAY_S) -> tuple[ReturnToView, ...]:
    """Find all returns of people who had a track before.

    Args:
        matching: A sequence, matched.
        away_s: Least time out of the view, seconds. Hidden behind something is in the view.

    Returns:
        One record for each return, in order of time; a visit in which the person never had to be
        tracked is none.
    """
    views = _frames_in_view(matching)
    found = [
        one
        for history in matching.histories
        for one in _returns_of(history, views[history.person], matching, away_s)
    ]
    return tuple(sorted(found, key=lambda one: one.frame))


def _returns_of(
    history: PersonHistory, view: I64, matching: Matching, away_s: float
) -> Iterator[ReturnToView]:
    gaps_s = np.diff(matching.sequence.stamps_s[view])
    leaves = np.flatnonzero(gaps_s >= away_s)
    backs = view[leaves + 1]  # first frame of each visit but the first
    ends = np.append(backs, len(matching.frame_matches))[1:]
    for away, back, end in zip(gaps_s[leaves], backs, ends, strict=True):
        known = history.tracks[(history.frames < back) & history.matched]
        visit = history.tracks[(history.frames >= back) & (history.frames < end)]
        if len(known) and len(visit):
            before, after = matching.tracks[known[-1]], _most(visit, matching)
            yield ReturnToView(history.person, int(back), float(away), before, after)


def _frames_in_view(matching: Matching) -> dict[Id, I64]:
    views: defaultdict[Id, list[int]] = defaultdict(list)
    for index, frame in enumerate(matching.sequence.frames):
        for person, in_view in zip(frame.truth.ids, frame.truth.in_view, strict=True):
            if in_view:
                views[person].append(index)
    return {person: np.array(frames) for person, frames in views.items()}


def _most(tracks: I64, matching: Matching) -> Id | None:
    numbers, frames = np.unique(tracks[tracks >= 0], return_counts=True)
    return matching.tracks[numbers[np.argmax(frames)]] if len(numbers) else None
