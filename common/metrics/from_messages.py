"""Evaluation frames from messages."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np

from common.metrics.record import BOOL, GroundTruth, Hypotheses
from people4d.messages import F64, Track, TruthPerson

FAR = 1e5  # [m], [m/s]: no person is so far away or so fast
P = TypeVar("P", Track, TruthPerson)


def ground_truth_of(
    people: Sequence[TruthPerson], out_of_view: BOOL | None = None, occluded: BOOL | None = None
) -> GroundTruth:
    """Return people as ground truth.

    Args:
        people: N, all of them `plausible`.
        out_of_view: N; None if the view is not known.
        occluded: N; None if none is.
    """
    return GroundTruth(
        ids=tuple(person.id for person in people),
        positions_m=_vectors([person.position_m for person in people]),
        velocities_mps=_vectors([person.velocity_mps for person in people]),
        yaws_rad=_angles([person.yaw_rad for person in people]),
        out_of_view=out_of_view,
        occluded=occluded,
    )


def hypotheses_of(tracks: Iterable[Track]) -> Hypotheses:
    """Return plausible tracks as hypotheses; tentative ones are not reported as people."""
    reported = {track.id: track for track in tracks if track.state != "tentative"}
    people = plausible(reported.values())
    return Hypotheses(
        ids=tuple(track.id for track in people),
        positions_m=_vectors([track.position_m for track in people]),
        velocities_mps=_vectors([track.velocity_mps for track in people]),
        yaws_rad=_angles([track.yaw_rad for track in people]),
        predicted=np.array([track.state == "lost" for track in people], np.bool_),
    )


def plausible(people: Iterable[P]) -> tuple[P, ...]:
    """Return the people whose position and velocity are within reason."""
    return tuple(
        person
        for person in people
        if np.abs(person.position_m).max() <= FAR
        and (person.velocity_mps is None or np.abs(person.velocity_mps).max() <= FAR)
    )


def _vectors(vectors: Sequence[F64 | None]) -> F64:
    rows = [np.full(3, np.nan) if vector is None else vector for vector in vectors]
    return np.array(rows, np.float64).reshape(-1, 3)


def _angles(angles: Sequence[float | None]) -> F64:
    return np.array([np.nan if angle is None else angle for angle in angles], np.float64)
