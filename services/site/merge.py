"""People of several areas, each person once."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from people4d.messages import Track

CONFLICT_M = 1.5  # between two measured tracks of one identity that are two people


@dataclass(frozen=True, slots=True)
class Merged:
    """Tracks of all areas."""

    tracks: tuple[Track, ...]  # each person once, by id
    doubles: int  # tracks left out: people who have another identity in a second area
    conflicts: int  # tracks left out: other people under an identity that is used twice


def merge(areas: Mapping[str, Iterable[Track]], same_m: float) -> Merged:
    """Return the tracks of all areas, each identity and each person once.

    Of an identity that two areas have, the track that was measured last counts. Two tracks of two
    areas with other identities that are nearer to each other than `same_m` are one person, who has
    the identity of the longer one.
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
        near = (_distance_m(track, t) < same_m for other, t in accepted if other != area)
        if not any(near):
            accepted.append((area, track))
    tracks = tuple(sorted((track for _, track in accepted), key=lambda track: track.id))
    return Merged(tracks, len(best) - len(accepted), conflicts)


def predicted(track: Track, dt_s: float) -> Track:
    """Return a track some time later, at constant velocity."""
    step = np.eye(6)
    step[:3, 3:] = dt_s * np.eye(3)
    return replace(
        track,
        position_m=track.position_m + dt_s * track.velocity_mps,
        covariance=step @ track.covariance @ step.T,
    )


def _distance_m(a: Track, b: Track) -> float:
    return math.dist(a.position_m[:2], b.position_m[:2])
