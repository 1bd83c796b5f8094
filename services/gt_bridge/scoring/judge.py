"""Frames judged one after another: who was found, how well, and under which identity."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np

from common.geometry.transforms import wrap
from common.metrics import (
    EvaluationFrame,
    EvaluationSequence,
    GroundDistance,
    GroundTruth,
    Hypotheses,
    Matcher,
    Matching,
    PoseErrors,
)
from common.metrics.pose import pose_errors
from common.metrics.record import BOOL
from people4d.messages import F64, PersonScore, Tally, Track, Tracks, Truth, TruthPerson
from services.gt_bridge.scoring.tallies import Identities, Sums, Tallies

THRESHOLD = 0.5  # of `GroundDistance`: the gate itself
FAR = 1e5  # [m], [m/s]: no person is so far away or so fast
P = TypeVar("P", Track, TruthPerson)


class Judge:
    """Matches truth and tracks as `common.metrics` does, and adds up.

    Args:
        gate_m: Largest distance on the ground between a person and their track.
    """

    def __init__(self, gate_m: float) -> None:
        self._matcher = Matcher(GroundDistance(gate_m), THRESHOLD)
        self._tallies = Tallies()
        self._identities = Identities()

    @property
    def identities(self) -> int:
        """Number of people and tracks so far."""
        return len(self._matcher.persons) + len(self._matcher.tracks)

    @property
    def recent(self) -> Tally:
        """Figures of the last seconds."""
        return self._tallies.recent()

    @property
    def total(self) -> Tally:
        """Figures of all frames."""
        return self._tallies.total()

    @property
    def consistency(self) -> float | None:
        """Share of all matches under each person's main track."""
        return self._identities.consistency()

    def judge(self, frame: EvaluationFrame) -> tuple[tuple[PersonScore, ...], tuple[int, ...]]:
        """Judge the next frame.

        Returns:
            Everyone in the truth, and the ids of the tracks that are nobody.
        """
        step = self._matcher.step(frame)
        errors = pose_errors(Matching(EvaluationSequence("", (frame,)), (), (), (step,), THRESHOLD))
        pairs = {int(i): int(j) for i, j in zip(step.rows, step.columns, strict=True)}
        rows = {i: k for k, i in enumerate(i for i in pairs if frame.truth.in_view[i])}
        people = tuple(
            self._person(frame, i, pairs.get(i), errors.select(_only(rows.get(i), len(rows))))
            for i in range(len(frame.truth.ids))
        )
        alarms = [k for k in np.flatnonzero(step.kept) if k not in pairs.values()]
        self._tallies.add(frame.stamp_ns, _count(people, len(alarms)).with_errors(errors))
        return people, tuple(int(frame.tracked.ids[k]) for k in alarms)

    def _person(
        self, frame: EvaluationFrame, i: int, j: int | None, error: PoseErrors
    ) -> PersonScore:
        truth, name = frame.truth, str(frame.truth.ids[i])
        inside = bool(truth.in_view[i])
        track = None if j is None else int(frame.tracked.ids[j])
        switched = inside and track is not None and self._identities.meet(name, track)
        return PersonScore(
            id=name,
            view="unknown" if truth.out_of_view is None else "inside" if inside else "outside",
            track=track,
            predicted=j is not None and bool(frame.tracked.was_predicted[j]),
            switched=switched,
            position_error_m=_known(error.position_m),
            velocity_error_mps=_known(error.velocity_mps),
            yaw_error_rad=_yaw_error(error),
            consistency=self._identities.consistency(name),
        )


def frame_of(tracks: Tracks, truth: Truth, outside: BOOL | None) -> EvaluationFrame:
    """Put tracks and truth of one stamp and frame together; tentative tracks are not told.

    Args:
        tracks: The tracks.
        truth: People at their stamp in their frame, all of them `near`.
        outside: Who of them is outside of every camera's view; None if that is not known.
    """
    told = {track.id: track for track in tracks.tracks if track.state != "tentative"}
    hypotheses = near(told.values())
    return EvaluationFrame(
        stamp_ns=tracks.stamp_ns,
        truth=GroundTruth(
            ids=tuple(person.id for person in truth.people),
            positions_m=_vectors([person.position_m for person in truth.people]),
            velocities_mps=_vectors([person.velocity_mps for person in truth.people]),
            yaws_rad=_angles([person.yaw_rad for person in truth.people]),
            out_of_view=outside,
        ),
        tracked=Hypotheses(
            ids=tuple(track.id for track in hypotheses),
            positions_m=_vectors([track.position_m for track in hypotheses]),
            velocities_mps=_vectors([track.velocity_mps for track in hypotheses]),
            yaws_rad=_angles([track.yaw_rad for track in hypotheses]),
            predicted=np.array([track.state == "lost" for track in hypotheses], np.bool_),
        ),
    )


def near(people: Iterable[P]) -> tuple[P, ...]:
    """Return those whose position and velocity are within reason."""
    return tuple(
        person
        for person in people
        if np.abs(person.position_m).max() <= FAR
        and (person.velocity_mps is None or np.abs(person.velocity_mps).max() <= FAR)
    )


def _count(people: Sequence[PersonScore], alarms: int) -> Sums:
    found = [person for person in people if person.track is not None and person.view != "outside"]
    outside = sum(person.view == "outside" for person in people)
    return Sums(
        frames=1,
        truths=len(people) - outside,
        matched=len(found),
        predicted=sum(person.predicted for person in found),
        outside=outside,
        false_alarms=alarms,
        id_switches=sum(person.switched for person in found),
    )


def _only(row: int | None, n: int) -> BOOL:
    wanted = np.zeros(n, np.bool_)
    if row is not None:
        wanted[row] = True
    return wanted


def _known(errors: F64) -> F64 | None:
    """Return the one error (1x2) if there is one and it is known."""
    return errors[0] if len(errors) and np.isfinite(errors[0]).all() else None


def _yaw_error(error: PoseErrors) -> float | None:
    told_rad, true_rad = error.yaw_told_rad, error.yaw_true_rad
    if not len(told_rad) or not np.isfinite(told_rad[0] - true_rad[0]):
        return None
    return wrap(float(told_rad[0] - true_rad[0]))


def _vectors(vectors: Sequence[F64 | None]) -> F64:
    rows = [np.full(3, np.nan) if vector is None else vector for vector in vectors]
    return np.array(rows, np.float64).reshape(-1, 3)


def _angles(angles: Sequence[float | None]) -> F64:
    return np.array([np.nan if angle is None else angle for angle in angles], np.float64)
