"""Lines of filmstrips of ID switches."""

from typing import Literal

import numpy as np

from evaluation.report.filmstrips import _tracks_near
from people4d.messages import Track, Tracks


def track(
    number: int,
    x: float,
    identity: Literal["new", "continued", "reidentified", "refused"] | None = None,
    confidence: float | None = None,
    reason: str = "",
) -> Track:
    return Track(
        id=number,
        state="confirmed",
        position_m=np.array([x, 0.0, 1.0]),
        velocity_mps=np.zeros(3),
        covariance=np.eye(6),
        yaw_rad=None,
        hits=3,
        age=3,
        time_since_update_s=0.0,
        detection=0,
        score=0.9,
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
    tracks = Tracks(
        stamp_ns=0, sequence=0, frame_id="map", tracker="strongsort3d", camera="c", tracks=people
    )
    assert _tracks_near(tracks, np.array([1.0, 0.0, 1.0])) == [
        "ID 9: confirmed, 0.50 m",
        "reidentified 0.61: looks 0.12 from 9, 0.19 from 4",
        "ID 7: confirmed, 1.00 m",
        "continued 0.97",
        "ID 4: confirmed, 1.40 m",
    ]
