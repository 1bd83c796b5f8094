"""Filter of the motion of all people, from tracks at any rate."""

import math
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.predictor.motion import (
    POSITION,
    SIGMA_FIRST_MPS,
    STANDING,
    VELOCITY,
    Flags,
    Integers,
    MotionEstimate,
    initial_motion,
    predict_motion,
    update_motion,
)

SAMPLE_S = 0.4  # minimum interval between two independent positions of a track [s]
SIGMA_M = 0.05  # initial standard deviation of a measured position, per axis [m]
SIGMA_MIN_M = 0.005  # minimum standard deviation of a measured position [m]
NOISE_FACTOR = 1.7  # ratio of the standard deviation to the measured jitter
# Ratios of standard deviations of measurements to the tracks' covariances, which overestimate
# errors of velocities
POSITION_FACTOR, VELOCITY_FACTOR = 0.9, 0.3
SIGMA_MIN_MPS = 0.02  # minimum standard deviation of a measured velocity [m/s]
NOISE_GAIN = 0.03  # minimum step of the running median of jitter, in its logarithm
MEDIAN_TO_SIGMA = 1 / 0.6745  # ratio of sigma to the median of a normal distribution
THIRD_DIFFERENCE = math.sqrt(20)  # standard deviation of third differences of unit noise
FORGET_S = 2.0  # maximum absence of a person [s]
REGULAR = 0.25  # maximum relative deviation of intervals for third differences


@dataclass(frozen=True)
class TrackedMotion:
    """Positions and velocities of N people, with standard deviations per axis."""

    ids: Integers  # N identities
    positions_m: F64  # Nx2
    sigma_m: F64  # N
    velocities_mps: F64  # Nx2
    sigma_mps: F64  # N, large if the velocity is unknown


@dataclass(frozen=True)
class Samples:
    """New independent positions of K people."""

    ids: Integers  # K identities
    before_s: F64  # K times of the previous sample
    before_m: F64  # Kx2, position of the previous sample
    now_s: float
    now_m: F64  # Kx2
    settled: Flags  # K, False for the first samples of a person, without velocity


class MotionFilter:
    """Interacting motion models of all people.

    Positions of consecutive frames have the same errors, so only one position every SAMPLE_S is a
    measurement. In between, the estimate is the last sample updated with the newest position.
    """

    def __init__(self) -> None:
        self._noise_m = SIGMA_M / NOISE_FACTOR
        self._noise_count = 0
        self._ids = np.zeros(0, np.int64)
        self._motion = initial_motion(np.zeros((0, 2)), np.zeros(0))
        self._times_s = np.zeros((0, 4))  # times of the last samples, newest first
        self._samples_m = np.zeros((0, 4, 2))
        self._updated_s = np.zeros(0)

    @property
    def sigma_m(self) -> float:
        """Standard deviation of a measured position, per axis, from the jitter of tracks [m]."""
        return max(NOISE_FACTOR * self._noise_m, SIGMA_MIN_M)

    def add_tracks(
        self, now_s: float, tracked: TrackedMotion
    ) -> tuple[MotionEstimate, F64, Samples]:
        """Return motion and measured velocities (Nx2) of N people, and the new samples."""
        rows = self._rows(now_s, tracked.ids, tracked.positions_m)
        self._updated_s[rows] = now_s
        elapsed_s = now_s - self._times_s[rows, 0]
        before = self._motion.select_people(rows)
        new = elapsed_s <= 0
        motion = predict_motion(before, np.maximum(elapsed_s, 1e-3))
        sigma_m = np.maximum(self.sigma_m, POSITION_FACTOR * tracked.sigma_m)
        motion = update_motion(motion, POSITION, tracked.positions_m, sigma_m)
        if new.any():
            motion = _select(new, before, motion)
        sigma_mps = np.maximum(VELOCITY_FACTOR * tracked.sigma_mps, SIGMA_MIN_MPS)
        motion = update_motion(motion, VELOCITY, tracked.velocities_mps, sigma_mps)
        due = elapsed_s >= 0.9 * SAMPLE_S
        moved_m = tracked.positions_m - self._samples_m[rows, 0]
        measured_mps = np.where(
            due[:, None], moved_m / np.maximum(elapsed_s, 1e-3)[:, None], motion.velocity_mps
        )
        known = tracked.sigma_mps < SIGMA_FIRST_MPS
        measured_mps = np.where(known[:, None], tracked.velocities_mps, measured_mps)
        samples = self._store_samples(
            now_s, rows[due], tracked.positions_m[due], motion.select_people(due)
        )
        return motion, measured_mps, samples

    def _rows(self, now_s: float, ids: Integers, positions_m: F64) -> Integers:
        """Return the row of each person; add new people, remove people absent for long."""
        if np.array_equal(ids, self._ids) and (now_s - self._updated_s <= FORGET_S).all():
            return np.arange(len(ids))
        keep = now_s - self._updated_s <= FORGET_S
        new = ~np.isin(ids, self._ids[keep])
        if not keep.all() or new.any():
            begun = initial_motion(positions_m[new], np.full(int(new.sum()), self.sigma_m))
            self._motion = _join(self._motion.select_people(keep), begun)
            times_s = np.full((int(new.sum()), 4), np.nan)
            times_s[:, 0] = now_s
            self._times_s = np.concatenate([self._times_s[keep], times_s])
            samples_m = np.repeat(positions_m[new][:, None], 4, axis=1)
            self._samples_m = np.concatenate([self._samples_m[keep], samples_m])
            self._updated_s = np.concatenate(
                [self._updated_s[keep], np.full(len(samples_m), now_s)]
            )
            self._ids = np.concatenate([self._ids[keep], ids[new]])
        order = np.argsort(self._ids)
        found: Integers = order[np.searchsorted(self._ids, ids, sorter=order)]
        return found

    def _store_samples(
        self, now_s: float, rows: Integers, positions_m: F64, motion: MotionEstimate
    ) -> Samples:
        """Store samples, from which the filter continues."""
        samples = Samples(
            self._ids[rows],
            self._times_s[rows, 0],
            self._samples_m[rows, 0],
            now_s,
            positions_m,
            np.isfinite(self._times_s[rows, 1]),
        )
        if not len(rows):
            return samples
        for stored, new in zip(_parts(self._motion), _parts(motion), strict=True):
            stored[rows] = new
        self._times_s[rows, 1:] = self._times_s[rows, :-1]
        self._samples_m[rows, 1:] = self._samples_m[rows, :-1]
        self._times_s[rows, 0], self._samples_m[rows, 0] = now_s, positions_m
        self._learn_noise(rows, motion)
        return samples

    def _learn_noise(self, rows: Integers, motion: MotionEstimate) -> None:
        """Update the running median of third differences of walking people."""
        intervals_s = -np.diff(self._times_s[rows], axis=1)
        mean_s = intervals_s.mean(axis=1, keepdims=True)
        with np.errstate(invalid="ignore"):
            regular = (np.abs(intervals_s - mean_s) <= REGULAR * mean_s).all(axis=1)
        walking = regular & (motion.modes[:, STANDING] < 0.5)
        third = self._samples_m[rows[walking]] * np.array([1.0, -3.0, 3.0, -1.0])[:, None]
        jitter_m = np.abs(third.sum(axis=1)).ravel() * MEDIAN_TO_SIGMA / THIRD_DIFFERENCE
        above = np.sign(jitter_m - self._noise_m).sum()
        self._noise_count += len(jitter_m)
        gain = max(NOISE_GAIN, 1 / (1 + self._noise_count / 4))
        factor = math.exp(float(np.clip(gain * above, -0.7, 0.7)))
        self._noise_m = float(np.clip(self._noise_m * factor, 1e-4, 0.2))


def _parts(motion: MotionEstimate) -> tuple[F64, F64, F64]:
    return motion.states, motion.covariances, motion.modes


def _join(one: MotionEstimate, two: MotionEstimate) -> MotionEstimate:
    both = zip(_parts(one), _parts(two), strict=True)
    return MotionEstimate(*(np.concatenate(parts) for parts in both))


def _select(choice: Flags, one: MotionEstimate, two: MotionEstimate) -> MotionEstimate:
    both = zip(_parts(one), _parts(two), strict=True)
    return MotionEstimate(
        *(np.where(choice.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in both)
    )
