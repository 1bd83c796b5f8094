"""Matches, ID switches and errors of one frame after another: the counts that all scores share.

Report, live score and evaluation all sum `ScoreTotals`, so they give the same figures.
"""

import math
from dataclasses import dataclass

import numpy as np

from common.metrics.counts import Counts
from common.metrics.pose import PoseErrors, frame_errors
from common.metrics.record import EvaluationFrame, FrameMatches, Id
from people4d.messages import F64, Tally


@dataclass(frozen=True)
class IdSwitch:
    """Match of a person to another track than at the last match."""

    person: Id
    before: Id  # track of the last match
    after: Id  # track of the new match
    last_frame: int  # index of the last frame with the previous track
    frame: int  # index of the first frame with the new track


@dataclass(frozen=True)
class ScoreTotals(Counts):
    """Counts and sums of squared errors over frames."""

    frames: int = 0
    truths: int = 0  # number of people to be tracked, over all frames
    matches: int = 0  # number of truths with a track
    predicted: int = 0  # number of matches to a track without a measurement in that frame
    outside: int = 0  # number of people out of view, over all frames; not in truths
    false_alarms: int = 0  # number of unmatched tracks, over all frames
    id_switches: int = 0  # number of matches to another track than at the person's last match
    poses: int = 0  # number of matches with a position error
    position_m2: float = 0.0
    velocities: int = 0  # number of matches with a velocity error
    velocity_m2ps2: float = 0.0
    yaws: int = 0  # number of matches with a yaw error
    yaw_rad2: float = 0.0
    yaw_cos: float = 0.0

    def tally(self, duration_ns: int) -> Tally:
        """Return the totals in the form of the message."""
        return Tally(
            frames=self.frames,
            duration_s=duration_ns / 1e9,
            truths=self.truths,
            matched=self.matches,
            predicted=self.predicted,
            outside=self.outside,
            false_alarms=self.false_alarms,
            id_switches=self.id_switches,
            position_rmse_m=_root_mean(self.position_m2, self.poses),
            velocity_rmse_mps=_root_mean(self.velocity_m2ps2, self.velocities),
            yaw_rmse_rad=_root_mean(self.yaw_rad2, self.yaws),
            yaw_correlation=self.yaw_cos / self.yaws if self.yaws else None,
        )


@dataclass(frozen=True)
class FrameScore:
    """Scores of one frame."""

    totals: ScoreTotals
    switches: tuple[IdSwitch, ...]
    errors: PoseErrors  # errors of the pairs whose person is in view, in order


class FrameScorer:
    """Scores matched frames in order of time."""

    def __init__(self) -> None:
        self._last: dict[Id, tuple[Id, int]] = {}  # track and frame of each person's last match
        self._frames = 0

    def score(self, frame: EvaluationFrame, matches: FrameMatches) -> FrameScore:
        """Score the next frame."""
        errors = frame_errors(frame, matches)
        switches = self._switches(frame, matches)
        required, found = matches.required, matches.required_pairs
        totals = ScoreTotals(
            frames=1,
            truths=int(np.count_nonzero(required)),
            matches=int(np.count_nonzero(found)),
            predicted=int(np.count_nonzero(frame.hypotheses.was_predicted[matches.columns[found]])),
            outside=int(np.count_nonzero(~frame.truth.in_view)),
            false_alarms=int(np.count_nonzero(matches.evaluated_tracks) - np.count_nonzero(found)),
            id_switches=len(switches),
        )
        return FrameScore(totals + _error_sums(errors.select(~errors.occluded)), switches, errors)

    def _switches(self, frame: EvaluationFrame, matches: FrameMatches) -> tuple[IdSwitch, ...]:
        index, switches = self._frames, []
        self._frames += 1
        pairs = zip(matches.rows, matches.columns, strict=True)
        for row, column in sorted(pairs, key=lambda pair: int(matches.persons[pair[0]])):
            if matches.required[row]:
                person, track = frame.truth.ids[row], frame.hypotheses.ids[column]
                before, last_frame = self._last.get(person, (track, index))
                if before != track:
                    switches.append(IdSwitch(person, before, track, last_frame, index))
                self._last[person] = track, index
        return tuple(switches)


def _error_sums(errors: PoseErrors) -> ScoreTotals:
    position_m = _finite(np.linalg.norm(errors.position_m, axis=1))
    velocity_mps = _finite(np.linalg.norm(errors.velocity_mps, axis=1))
    yaw_rad = _finite(errors.yaw_error_rad)
    return ScoreTotals(
        poses=len(position_m),
        position_m2=float(np.sum(position_m**2)),
        velocities=len(velocity_mps),
        velocity_m2ps2=float(np.sum(velocity_mps**2)),
        yaws=len(yaw_rad),
        yaw_rad2=float(np.sum(yaw_rad**2)),
        yaw_cos=float(np.sum(np.cos(yaw_rad))),
    )


def _finite(values: F64) -> F64:
    return values[np.isfinite(values)]


def _root_mean(squares: float, count: int) -> float | None:
    return math.sqrt(squares / count) if count else None
