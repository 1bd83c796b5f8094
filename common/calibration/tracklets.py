"""Short tracks of people in one camera: smoothed positions and velocities on a grid of time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.signal import savgol_filter

from common.calibration.observations import LIMBS, ObservedFrame, ObservedPerson
from people4d.messages import F64

STEP_S = 0.1  # [s] step of the grid
FINE = 4  # number of smoothing steps in a grid step
WINDOW = 21  # window of smoothing, 0.5 s [fine steps]
GAP_S = 0.45  # [s] maximum gap without a detection
LIMB_GAP_S = 0.25  # [s] maximum gap without a joint
LIMBS_COUNT = len(LIMBS)
GATE_M, SPEED_MAX_MPS = 0.35, 2.5  # maximum distance from the prediction [m], and its growth [m/s]
# [m] distance between two people below which their tracks end, since they may be exchanged
CLOSE_M = 0.6
LENGTH_S = 0.8  # [s] minimum duration of a track


@dataclass(frozen=True, slots=True)
class Tracklet:
    """One person's path through one camera's view, on the camera's own clock."""

    first: int  # grid step of the first position: time = step * STEP_S
    positions_m: F64  # Nx3, frame: optical
    velocities_mps: F64  # Nx3
    limbs: F64 | None = None  # Nx12x2, see ObservedPerson

    @property
    def last(self) -> int:
        """Grid step after the last position."""
        return self.first + len(self.positions_m)

    @property
    def extent_m(self) -> float:
        """Largest side of the bounding box of the path."""
        return float(np.ptp(self.positions_m, axis=0).max())


@dataclass(slots=True)
class _Open:
    """A track that is not finished."""

    times_s: list[float]
    positions_m: list[F64]
    limbs: list[F64]

    def predicted_m(self, time_s: float) -> F64:
        """Return the position at a later time, at constant velocity over the last half second."""
        back = next(
            (
                k
                for k in range(2, len(self.times_s) + 1)
                if self.times_s[-1] - self.times_s[-k] > 0.3
            ),
            None,
        )
        if back is None:
            return self.positions_m[-1]
        velocity = (self.positions_m[-1] - self.positions_m[-back]) / (
            self.times_s[-1] - self.times_s[-back]
        )
        return np.asarray(self.positions_m[-1] + velocity * (time_s - self.times_s[-1]))


def tracklets(frames: Sequence[ObservedFrame], origin_ns: int) -> list[Tracklet]:
    """Return the tracks of all people in the frames of one static camera.

    Args:
        frames: Frames by rising stamp.
        origin_ns: Stamp of grid step 0.
    """
    going: list[_Open] = []
    ended: list[_Open] = []
    for frame in frames:
        time_s = (frame.stamp_ns - origin_ns) / 1e9
        ended += [t for t in going if time_s - t.times_s[-1] > GAP_S]
        going = [t for t in going if time_s - t.times_s[-1] <= GAP_S]
        close = _close(frame.people)
        matches = _match(going, frame.people, time_s)
        for k, person in enumerate(frame.people):
            track = matches.get(k)
            if track is None:
                if not close[k]:
                    going.append(_Open([time_s], [person.position_m], [_limbs(person)]))
            elif not close[k]:
                track.times_s.append(time_s)
                track.positions_m.append(person.position_m)
                track.limbs.append(_limbs(person))
    return [made for track in ended + going if (made := _smooth(track)) is not None]


def _close(people: Sequence[ObservedPerson]) -> list[bool]:
    if len(people) < 2:
        return [False] * len(people)
    at = np.array([p.position_m for p in people])
    apart = np.linalg.norm(at[:, None] - at, axis=-1) + np.diag(np.full(len(at), np.inf))
    return [bool(d < CLOSE_M) for d in apart.min(axis=1)]


def _match(
    going: Sequence[_Open], people: Sequence[ObservedPerson], time_s: float
) -> dict[int, _Open]:
    if not going or not people:
        return {}
    at = np.array([p.position_m for p in people])
    expected = np.array([t.predicted_m(time_s) for t in going])
    cost = np.linalg.norm(expected[:, None] - at, axis=-1)
    waits_s = np.array([time_s - t.times_s[-1] for t in going])
    gates = GATE_M + SPEED_MAX_MPS * np.maximum(waits_s - 0.1, 0)
    cost = np.where(cost <= gates[:, None], cost, 1e3)
    rows, columns = linear_sum_assignment(cost)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return {j: going[i] for i, j in pairs if cost[i, j] < 1e3}


def _smooth(track: _Open) -> Tracklet | None:
    times, positions = np.array(track.times_s), np.array(track.positions_m)
    if times[-1] - times[0] < LENGTH_S:
        return None
    fine_s = STEP_S / FINE
    first, last = int(np.ceil(times[0] / STEP_S)), int(np.floor(times[-1] / STEP_S))
    grid = np.arange(first * FINE, last * FINE + 1) * fine_s
    if len(grid) < WINDOW:
        return None
    even = np.column_stack([np.interp(grid, times, positions[:, k]) for k in range(3)])
    smooth = savgol_filter(even, WINDOW, 2, axis=0)
    velocity = savgol_filter(even, WINDOW, 2, deriv=1, delta=fine_s, axis=0)
    limbs = _smooth_limbs(times, np.array(track.limbs), np.asarray(grid, np.float64))
    return Tracklet(first, smooth[::FINE], velocity[::FINE], limbs[::FINE])


def _limbs(person: ObservedPerson) -> F64:
    return np.full((LIMBS_COUNT, 2), np.nan) if person.limbs is None else person.limbs


def _smooth_limbs(times: F64, limbs: F64, grid: F64) -> F64:
    """Return smoothed rays (NxJx2) on a grid, NaN next to gaps of a joint."""
    found = np.full((len(grid), *limbs.shape[1:]), np.nan)
    for joint in range(limbs.shape[1]):
        has = ~np.isnan(limbs[:, joint, 0])
        if has.sum() < 3:
            continue
        known = times[has]
        even = [np.interp(grid, known, limbs[has, joint, axis]) for axis in range(2)]
        after = np.searchsorted(known, grid)
        gap = known[after.clip(0, len(known) - 1)] - known[(after - 1).clip(0)]
        is_known = (after > 0) & (after < len(known)) & (gap < LIMB_GAP_S)
        smooth = savgol_filter(np.column_stack(even), WINDOW, 2, axis=0)
        found[is_known, joint] = smooth[is_known]
    return found
