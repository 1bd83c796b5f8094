"""Figures over many frames in little memory: lately, and in all."""

import math
from collections import Counter
from typing import NamedTuple

import numpy as np

from common.metrics import PoseErrors
from people4d.messages import F64, Tally

RECENT_NS = 10 * 10**9
FRAMES = 1024  # that `recent` can cover: 10 s at 100 frames a second


class Sums(NamedTuple):
    """What adds up over frames; fields as in Tally, errors as sums of squares."""

    frames: float = 0
    truths: float = 0
    matched: float = 0
    predicted: float = 0
    outside: float = 0
    false_alarms: float = 0
    id_switches: float = 0
    poses: float = 0  # matches with a position
    position_m2: float = 0
    velocities: float = 0  # matches with a velocity in the truth
    velocity_m2ps2: float = 0
    yaws: float = 0  # matches with a yaw on both sides
    yaw_rad2: float = 0
    yaw_cos: float = 0

    def with_errors(self, errors: PoseErrors) -> "Sums":
        """Return the sums with the errors of the matches."""
        position, velocity, yaw = (
            values[np.isfinite(values)]
            for values in (
                np.linalg.norm(errors.position_m, axis=1),
                np.linalg.norm(errors.velocity_mps, axis=1),
                errors.yaw_error_rad,
            )
        )
        return self._replace(
            poses=len(position),
            position_m2=float(np.sum(position**2)),
            velocities=len(velocity),
            velocity_m2ps2=float(np.sum(velocity**2)),
            yaws=len(yaw),
            yaw_rad2=float(np.sum(yaw**2)),
            yaw_cos=float(np.sum(np.cos(yaw))),
        )

    def tally(self, duration_ns: int) -> Tally:
        """Return the figures."""
        return Tally(
            frames=round(self.frames),
            duration_s=duration_ns / 1e9,
            truths=round(self.truths),
            matched=round(self.matched),
            predicted=round(self.predicted),
            outside=round(self.outside),
            false_alarms=round(self.false_alarms),
            id_switches=round(self.id_switches),
            position_rmse_m=_root_mean(self.position_m2, self.poses),
            velocity_rmse_mps=_root_mean(self.velocity_m2ps2, self.velocities),
            yaw_rmse_rad=_root_mean(self.yaw_rad2, self.yaws),
            yaw_correlation=self.yaw_cos / self.yaws if self.yaws else None,
        )


class Tallies:
    """Sums of the last seconds and of everything."""

    def __init__(self) -> None:
        self._rows: F64 = np.zeros((FRAMES, len(Sums._fields)))
        self._stamps_ns = np.full(FRAMES, np.iinfo(np.int64).min)
        self._count = 0
        self._total = Sums()
        self._first_ns = self._last_ns = 0

    def add(self, stamp_ns: int, sums: Sums) -> None:
        """Add one frame."""
        row = self._count % FRAMES
        self._rows[row], self._stamps_ns[row] = sums, stamp_ns
        self._total = Sums(*(a + b for a, b in zip(self._total, sums, strict=True)))
        self._first_ns = stamp_ns if not self._count else self._first_ns
        self._last_ns = stamp_ns
        self._count += 1

    def recent(self) -> Tally:
        """Return the figures of the last seconds."""
        rows = np.flatnonzero(self._stamps_ns > self._last_ns - RECENT_NS)[: self._count]
        first_ns = int(self._stamps_ns[rows].min()) if len(rows) else self._last_ns
        return Sums(*self._rows[rows].sum(axis=0).tolist()).tally(self._last_ns - first_ns)

    def total(self) -> Tally:
        """Return the figures of everything."""
        return self._total.tally(self._last_ns - self._first_ns)


class Identities:
    """Under which tracks each person went."""

    def __init__(self) -> None:
        self._last: dict[str, int] = {}
        self._tracks: dict[str, Counter[int]] = {}

    def meet(self, person: str, track: int) -> bool:
        """Note a match; tells whether the last match of this person was another track."""
        switched = self._last.get(person, track) != track
        self._last[person] = track
        self._tracks.setdefault(person, Counter())[track] += 1
        return switched

    def consistency(self, *persons: str) -> float | None:
        """Return the share of matches under each person's most frequent track.

        Args:
            persons: Who is asked for; everyone if nobody is named.
        """
        counters = [self._tracks[p] for p in persons or self._tracks if p in self._tracks]
        matches = sum(counter.total() for counter in counters)
        return sum(max(c.values()) for c in counters) / matches if matches else None


def _root_mean(squares: float, count: float) -> float | None:
    return math.sqrt(squares / count) if count else None
