"""CLEAR-MOT (Bernardin & Stiefelhagen 2008), with the trajectory counts of Li et al. 2009."""

from dataclasses import dataclass

import numpy as np

from common.metrics.counts import Counts, ratio
from common.metrics.matching import Matching, PersonHistory
from common.metrics.record import Id

MOSTLY_TRACKED = 0.8  # of the frames in which a person had to be found; more is mostly tracked
MOSTLY_LOST = 0.2  # less is mostly lost


@dataclass(frozen=True)
class ClearCounts(Counts):
    """What CLEAR-MOT counts."""

    matches: int = 0  # true positives
    misses: int = 0  # false negatives, FN
    false_alarms: int = 0  # false positives, FP
    id_switches: int = 0  # matches to another track than the person's last match
    fragmentations: int = 0  # times that a person was found again after being missed
    mostly_tracked: int = 0  # people
    partly_tracked: int = 0  # people
    mostly_lost: int = 0  # people
    similarity: float = 0.0  # sum over the matches

    @property
    def truths(self) -> int:
        """People to be found, over all frames."""
        return self.matches + self.misses

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
        """Share of the people to be found that were."""
        return ratio(self.matches, self.truths)

    @property
    def precision(self) -> float:
        """Share of the tracks that were people."""
        return ratio(self.matches, self.matches + self.false_alarms)


@dataclass(frozen=True)
class IdSwitch:
    """A person matched to another track than the last time."""

    person: Id
    before: Id  # track of the last match
    after: Id  # track from now on
    last_frame: int  # index of the last frame with the track before
    frame: int  # index of the first frame with the track after


def count_clear(matching: Matching) -> ClearCounts:
    """Count matches and errors (method book section 9)."""
    histories = matching.histories
    matches = sum(int(history.matched.sum()) for history in histories)
    kept = sum(int(step.kept.sum()) for step in matching.steps)
    shares = np.array([history.matched.mean() for history in histories])
    tracked = int((shares > MOSTLY_TRACKED).sum())
    lost = int((shares < MOSTLY_LOST).sum())
    return ClearCounts(
        matches=matches,
        misses=sum(len(history.tracks) for history in histories) - matches,
        false_alarms=kept - matches,
        id_switches=len(id_switches(matching)),
        fragmentations=sum(_fragmentations(history) for history in histories),
        mostly_tracked=tracked,
        partly_tracked=len(histories) - tracked - lost,
        mostly_lost=lost,
        similarity=sum(
            float(step.similarity[step.rows[step.found], step.columns[step.found]].sum())
            for step in matching.steps
        ),
    )


def id_switches(matching: Matching) -> tuple[IdSwitch, ...]:
    """Return every ID switch, in order of time."""
    switches = []
    for history in matching.histories:
        tracks, frames = history.tracks[history.matched], history.frames[history.matched]
        for i in np.flatnonzero(np.diff(tracks)):
            before, after = matching.tracks[tracks[i]], matching.tracks[tracks[i + 1]]
            switches.append(
                IdSwitch(history.person, before, after, int(frames[i]), int(frames[i + 1]))
            )
    return tuple(sorted(switches, key=lambda switch: switch.frame))


def _fragmentations(history: PersonHistory) -> int:
    found = np.flatnonzero(history.matched)
    return int(np.count_nonzero(np.diff(found) > 1))
