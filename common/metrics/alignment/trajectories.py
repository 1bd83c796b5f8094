"""Trajectories of people and tracks, and pairs of tracks and the people nearest to them."""

import math
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from common.geometry.transforms import apply
from common.metrics.record import BOOL, I64
from people4d.messages import F64

GATE_M = 1.0  # [m] maximum distance of a used track from the nearest person
CLEAR_M = 0.3  # [m] minimum extra distance of the second nearest person
MAX_GAP_S = 0.2  # [s] maximum interval of interpolated truth
HALF_STEP_S = 0.02  # [s] half the interval over which velocity is measured


@dataclass(frozen=True)
class Trajectory:
    """Positions of one identity over time."""

    stamps_s: F64  # [s] N, rising
    positions_m: F64  # [m] Nx3

    def at(self, stamps_s: F64) -> F64:
        """Return positions (Mx3) at other stamps (M), NaN where the samples are too far apart."""
        after = np.clip(np.searchsorted(self.stamps_s, stamps_s), 0, len(self.stamps_s) - 1)
        before = np.clip(np.searchsorted(self.stamps_s, stamps_s, "right") - 1, 0, None)
        inside = (stamps_s >= self.stamps_s[0]) & (stamps_s <= self.stamps_s[-1])
        known = inside & (self.stamps_s[after] - self.stamps_s[before] <= MAX_GAP_S)
        columns = [np.interp(stamps_s, self.stamps_s, column) for column in self.positions_m.T]
        return np.where(known[:, None], np.column_stack(columns), np.nan)


# Trajectory by identity, which is text or number
Trajectories: TypeAlias = Mapping[Any, Trajectory]


@dataclass(frozen=True)
class TrajectoryPairs:
    """Positions of tracks and of the truth paired with them, K samples."""

    true_m: F64  # [m] Kx3
    velocity_mps: F64  # [m/s] Kx3, velocity of the truth
    tracked_m: F64  # [m] Kx3

    def rmse_m(self, matrix: F64) -> float:
        """Return the horizontal error after a motion (4x4) of the truth, NaN if there is none."""
        error = (self.tracked_m - apply(matrix, self.true_m))[:, :2]
        return float(np.sqrt(np.mean(np.sum(error**2, axis=1)))) if len(error) else math.nan


def trajectories_of(
    samples: Iterable[tuple[Hashable, int, F64]], start_ns: int
) -> dict[Hashable, Trajectory]:
    """Gather positions by identity, seconds since a start.

    Samples are identity, stamp in nanoseconds and position (3), by rising stamp.
    """
    rows: dict[Hashable, list[tuple[float, F64]]] = {}
    for identity, stamp_ns, position_m in samples:
        rows.setdefault(identity, []).append(((stamp_ns - start_ns) / 1e9, position_m))
    return {
        identity: Trajectory(np.array([t for t, _ in row]), np.array([p for _, p in row]))
        for identity, row in rows.items()
    }


def pair_up(
    truth: Trajectories, tracked: Trajectories, offset_s: float, matrix: F64 | None = None
) -> TrajectoryPairs:
    """Pair each position of a track with the nearest person, if near and unambiguous.

    The offset is added to stamps of the truth. A motion (4x4) is applied to the truth before it is
    compared; the pairs have the truth unmoved.
    """
    stamps_s, tracked_m = _samples(tracked)
    true_m, times_s = _everyone(truth, stamps_s - offset_s), stamps_s - offset_s
    near = _nearest(true_m if matrix is None else apply(matrix, true_m), tracked_m)
    earlier = _everyone(truth, times_s - HALF_STEP_S)
    later = _everyone(truth, times_s + HALF_STEP_S)
    velocity = _pick((later - earlier) / (2 * HALF_STEP_S), near.index)
    good = near.clear & (near.distance_m < GATE_M) & np.isfinite(velocity).all(axis=1)
    return TrajectoryPairs(_pick(true_m, near.index)[good], velocity[good], tracked_m[good])


def cost(truth: Trajectories, tracked: Trajectories, offset_s: float) -> float:
    """Return the mean distance of tracks to the nearest person, counted up to the gate."""
    stamps_s, tracked_m = _samples(tracked)
    distance_m = _nearest(_everyone(truth, stamps_s - offset_s), tracked_m).distance_m
    return float(np.minimum(distance_m, GATE_M).mean()) if len(distance_m) else 0.0


@dataclass(frozen=True)
class _Near:
    distance_m: F64  # N, to the nearest person; infinite if there is none
    index: I64  # N, index of that person
    clear: BOOL  # N, all others are clearly farther


def _nearest(true_m: F64, tracked_m: F64) -> _Near:
    apart = np.linalg.norm((true_m - tracked_m)[..., :2], axis=-1)
    absent = np.full((2, len(tracked_m)), np.inf)
    apart = np.vstack([np.where(np.isfinite(apart), apart, np.inf), absent])
    nearest, second = np.sort(apart, axis=0)[:2]
    return _Near(nearest, np.argmin(apart, axis=0), second >= nearest + CLEAR_M)


def _pick(people: F64, index: I64) -> F64:
    """Return for each row the position (Nx3) of one person among PxNx3, NaN if there is none."""
    padded = np.concatenate([people, np.full((2, *people.shape[1:]), np.nan)])
    return np.asarray(padded[index, np.arange(len(index))])


def _samples(tracked: Trajectories) -> tuple[F64, F64]:
    stamps = [np.zeros(0), *(path.stamps_s for path in tracked.values())]
    points = [np.zeros((0, 3)), *(path.positions_m for path in tracked.values())]
    return np.concatenate(stamps), np.concatenate(points)


def _everyone(truth: Trajectories, stamps_s: F64) -> F64:
    """Return the positions of all true people, PxNx3."""
    paths = [path.at(stamps_s) for path in truth.values()]
    return np.array(paths).reshape(len(paths), len(stamps_s), 3)
