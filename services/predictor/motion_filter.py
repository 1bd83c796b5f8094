"""Filter of the motion of all people, from positions at any rate."""

import math
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.predictor.config import PedestrianConfig
from services.predictor.motion import (
    POSITION,
    STANDING,
    VELOCITY,
    Flags,
    Integers,
    MotionEstimate,
    advance,
    begin,
    measure,
)

NOISE_GAIN = 0.03  # of the running median, in its logarithm, a sample; more at first
MEDIAN_TO_SIGMA = 1 / 0.6745  # of a normal distribution
THIRD_DIFFERENCE = math.sqrt(20)  # its standard deviation with independent noise of 1
FORGET_S = 2.0  # [s] after which an absent person is forgotten
REGULAR = 0.25  # part by which two intervals may differ for a difference of positions


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
    """New independent positions of some of the people."""

    ids: Integers  # of K people
    before_s: F64  # K times of the sample before
    before_m: F64  # Kx2 its position
    now_s: float
    now_m: F64  # Kx2
    settled: Flags  # K, False for the first samples of a person, of unknown velocity


class MotionFilter:
    """Interacting motion models of all people.

    Tracks are smooth: positions of neighbouring frames have the same errors. So a position counts
    as a measurement once every `sample_s`; in between the estimate starts from the last sample and
    takes the newest position as its only measurement.
    """

    def __init__(self, config: PedestrianConfig) -> None:
        self._config = config
        self._noise_m = config.sigma_m / config.noise_factor
        self._noise_count = 0
        self._ids = np.zeros(0, np.int64)
        self._motion = begin(np.zeros((0, 2)), np.zeros(0), config)
        self._times_s = np.zeros((0, 4))  # of the last samples, newest first
        self._samples_m = np.zeros((0, 4, 2))
        self._updated_s = np.zeros(0)

    @property
    def sigma_m(self) -> float:
        """Standard deviation of a measured position, per axis, learned from their jitter [m]."""
        return max(self._config.noise_factor * self._noise_m, self._config.sigma_min_m)

    def update(self, now_s: float, tracked: TrackedMotion) -> tuple[MotionEstimate, F64, Samples]:
        """Return motion and measured velocities (Nx2) of N people, and who has a new sample."""
        rows = self._rows(now_s, tracked.ids, tracked.positions_m)
        self._updated_s[rows] = now_s
        elapsed_s = now_s - self._times_s[rows, 0]
        before = self._motion.at(rows)
        new = elapsed_s <= 0
        motion = advance(before, np.maximum(elapsed_s, 1e-3), self._config)
        config = self._config
        sigma_m = np.maximum(self.sigma_m, config.track_factors[POSITION] * tracked.sigma_m)
        motion = measure(motion, POSITION, tracked.positions_m, sigma_m)
        motion = _select(new, before, motion)
        sigma_mps = np.maximum(
            config.track_factors[VELOCITY] * tracked.sigma_mps, config.sigma_min_mps
        )
        motion = measure(motion, VELOCITY, tracked.velocities_mps, sigma_mps)
        due = elapsed_s >= 0.9 * self._config.sample_s
        moved_m = tracked.positions_m - self._samples_m[rows, 0]
        measured_mps = np.where(
            due[:, None], moved_m / np.maximum(elapsed_s, 1e-3)[:, None], motion.velocity_mps
        )
        known = tracked.sigma_mps < config.sigma_first_mps
        measured_mps = np.where(known[:, None], tracked.velocities_mps, measured_mps)
        samples = self._take(now_s, rows[due], tracked.positions_m[due], motion.at(due))
        return motion, measured_mps, samples

    def _rows(self, now_s: float, ids: Integers, positions_m: F64) -> Integers:
        """Return the row of each person; add new ones, forget those long absent."""
        if np.array_equal(ids, self._ids) and (now_s - self._updated_s <= FORGET_S).all():
            return np.arange(len(ids))
        keep = now_s - self._updated_s <= FORGET_S
        new = ~np.isin(ids, self._ids[keep])
        if not keep.all() or new.any():
            begun = begin(positions_m[new], np.full(int(new.sum()), self.sigma_m), self._config)
            self._motion = _join(self._motion.at(keep), begun)
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

    def _take(
        self, now_s: float, rows: Integers, positions_m: F64, motion: MotionEstimate
    ) -> Samples:
        """Take samples: the filter continues from them."""
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
        """Follow the median of third differences of people who walk."""
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


def _parts(motion: MotionEstimate) -> tuple[F64, F64, F64, F64]:
    return motion.positions_m, motion.velocities_mps, motion.covariances, motion.modes


def _join(one: MotionEstimate, two: MotionEstimate) -> MotionEstimate:
    both = zip(_parts(one), _parts(two), strict=True)
    return MotionEstimate(*(np.concatenate(parts) for parts in both))


def _select(choice: Flags, one: MotionEstimate, two: MotionEstimate) -> MotionEstimate:
    both = zip(_parts(one), _parts(two), strict=True)
    return MotionEstimate(
        *(np.where(choice.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in both)
    )
