"""Evaluation frames from messages."""

from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

import numpy as np

from common.metrics.record import BOOL, GroundTruth, Hypotheses
from people4d.messages import F64, Track, TruthPerson

FAR = 1e5  # maximum distance [m] and speed [m/s] of a plausible person
P = TypeVar("P", Track, TruthPerson)


def ground_truth_of(
    people: Sequence[TruthPerson], out_of_view: BOOL | None = None, occluded: BOOL | None = None
) -> GroundTruth:
    """Return N people, all `plausible`, as ground truth, with flags (N each).

    `out_of_view` is None if the view is unknown, `occluded` is None if all are unoccluded.
    """
    return GroundTruth(**_columns(people), out_of_view=out_of_view, occluded=occluded)


def hypotheses_of(tracks: Iterable[Track]) -> Hypotheses:
    """Return plausible tracks as hypotheses, except tentative ones."""
    reported = {track.id: track for track in tracks if track.state != "tentative"}
    people = plausible(reported.values())
    predicted = np.array([track.state == "lost" for track in people], np.bool_)
    return Hypotheses(**_columns(people), predicted=predicted)


def plausible(people: Iterable[P]) -> tuple[P, ...]:
    """Return the people with a plausible position and velocity."""
    return tuple(
        person
        for person in people
        if np.abs(person.position_m).max() <= FAR
        and (person.velocity_mps is None or np.abs(person.velocity_mps).max() <= FAR)
    )


def _columns(people: Sequence[Track] | Sequence[TruthPerson]) -> dict[str, Any]:
    def column(values: Iterable[F64 | float | None], *width: int) -> F64:
        rows = [np.full(width, np.nan) if value is None else value for value in values]
        return np.array(rows, np.float64).reshape(-1, *width)

    return {
        "ids": tuple(person.id for person in people),
        "positions_m": column((person.position_m for person in people), 3),
        "velocities_mps": column((person.velocity_mps for person in people), 3),
        "yaws_rad": column(person.yaw_rad for person in people),
    }
