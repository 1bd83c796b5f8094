"""Lines of filmstrips of ID switches."""

from typing import Literal

import numpy as np

from evaluation.report.filmstrips import _tracks_near
from people4d.messages import Track
from tests import builders


def track(
    number: int,
    x: float,
    identity: Literal["new", "continued", "reidentified"] | None = None,
    confidence: float | None = None,
    reason: str = "",
) -> Track:
    return builders.track(
        id=number,
        position_m=np.array([x, 0.0, 1.0]),
        identity=identity,
        identity_confidence=confidence,
        identity_reason=reason,
    )


def test_tracks_are_tracks_near_with_who_they_were_taken_for() -> None:
    # At 0.5, 1 and 1.4 m from the person, nearest first; the last one, at 3 m, is not near.
    people = (
        track(4, 2.4),
        track(7, 2.0, "continued", 0.97),
        track(9, 1.5, "reidentified", 0.61, "looks 0.12 from 9, 0.19 from 4"),
        track(2, 4.0),
    )
    tracks = builders.tracks(*people, tracker="strongsort3d", camera="c")
    assert _tracks_near(tracks, np.array([1.0, 0.0, 1.0])) == [
        "ID 9: confirmed, 0.50 m",
        "reidentified 0.61: looks 0.12 from 9, 0.19 from 4",
        "ID 7: confirmed, 1.00 m",
        "continued 0.97",
        "ID 4: confirmed, 1.40 m",
    ]
