"""Merging of the tracks of several areas, each person once."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from people4d.messages import Track

SAME_M = 0.5  # maximum distance on the ground between two tracks of one person in two areas [m]
CONFLICT_M = 1.5  # minimum distance between measured tracks of two people with one identity [m]


@dataclass(frozen=True, slots=True)
class Merged:
    """Tracks of all areas."""

    tracks: tuple[Track, ...]  # each person once, sorted by id
    doubles: int  # number of omitted tracks of people with another identity in a second area
    conflicts: int  # number of omitted tracks of a second person with the same identity


def merge(areas: Mapping[str, Iterable[Track]]) -> Merged:
    """Return the tracks of all areas, each identity and each person once.

    If two areas have one identity, the more recently measured track counts. If tracks of two areas
    with different identities are closer than SAME_M, they are one person, with the identity of
    the longer track.
    """
    best: dict[int, tuple[str, Track]] = {}
    conflicts = 0
    for area, tracks in areas.items():
        for track in tracks:
            if track.id not in best:
                best[track.id] = area, track
                continue
            other = best[track.id][1]
            measured = track.detection is not None and other.detection is not None
            if measured and _distance_m(track, other) > CONFLICT_M:
                conflicts += 1
                is_better = track.hits > other.hits
            else:
                is_better = track.time_since_update_s < other.time_since_update_s
            if is_better:
                best[track.id] = area, track
    accepted: list[tuple[str, Track]] = []
    for area, track in sorted(best.values(), key=lambda one: (-one[1].hits, one[1].id)):
        near = (_distance_m(track, t) < SAME_M for other, t in accepted if other != area)
        if not any(near):
            accepted.append((area, track))
    tracks = tuple(sorted((track for _, track in accepted), key=lambda track: track.id))
    return Merged(tracks, len(best) - len(accepted), conflicts)


def predicted(track: Track, dt_s: float) -> Track:
    """Return the prediction of a track at constant velocity."""
    step = np.eye(6)
    step[:3, 3:] = dt_s * np.eye(3)
    return replace(
        track,
        position_m=track.position_m + dt_s * track.velocity_mps,
        covariance=step @ track.covariance @ step.T,
    )


def _distance_m(a: Track, b: Track) -> float:
    return math.dist(a.position_m[:2], b.position_m[:2])
