"""Filters of the states of tracks: one motion model, or two interacting ones.

The velocity of unmatched tracks may decay.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from common import imm, kalman
from people4d.messages import F64
from services.tracker.motion.motion import Motion, PositionMotion
from services.tracker.motion.track_record import BOOL, ImmState, TrackRecord, stack

VELOCITY_DECAY_S = 0.7  # time constant of the velocity of unmatched tracks [s]
WALKING_SIGMA_MPS = 0.6  # standard deviation of a walking person's velocity, per axis [m/s]
STANDING, WALKING = 0, 1  # modes
STANDING_SIGMA_MPS = 0.03  # standard deviation of a standing person's velocity [m/s]
DRIFT_M2PS = 0.0005  # growth of the variance of a standing person's position [m^2/s]
STANDING_S, WALKING_S = 0.5, 10.0  # mean durations of standing and of walking [s]
IS_POSITION = np.pad(np.ones((3, 3)), (0, 3))  # mask of the position block of a covariance
ON_POSITION = IS_POSITION * np.eye(6)
# Mask of the estimated elements of the covariance, by mode
OWN = np.array([IS_POSITION, np.ones((6, 6))])

# Decay of states (Nxn) and covariances (Nxnxn) of unmatched tracks (mask N) over a time step [s]
Decay: TypeAlias = Callable[[F64, F64, BOOL, float], tuple[F64, F64]]


class FilterState(NamedTuple):
    """The state of one track after a step."""

    x: F64
    P: F64
    imm: ImmState | None = None


def no_decay(x: F64, P: F64, unmatched: BOOL, dt_s: float) -> tuple[F64, F64]:  # noqa: ARG001
    """Keep the velocity of unmatched tracks."""
    return x, P


def decay_velocity(x: F64, P: F64, unmatched: BOOL, dt_s: float) -> tuple[F64, F64]:
    """Return states (Nx6) and covariances (Nx6x6) with decayed velocities of unmatched tracks.

    An Ornstein-Uhlenbeck process: over dt the velocity shrinks by k = exp(-dt / tau), and
    (1 - k^2) sigma^2 is added to its variance, so the uncertainty of the position grows while the
    prediction comes to rest.
    """
    if not unmatched.any():
        return x, P
    k = math.exp(-dt_s / VELOCITY_DECAY_S)
    factor, variance = np.ones_like(x), np.zeros_like(x)
    factor[unmatched, 3:] = k
    # Walking people do not move up or down.
    variance[unmatched, 3:5] = (1 - k**2) * WALKING_SIGMA_MPS**2
    P = factor[:, :, None] * P * factor[:, None]
    return factor * x, P + variance[:, :, None] * np.eye(x.shape[1])


class KalmanFilter:
    """One motion model.

    Args:
        motion: Motion model.
        decay: Applied to unmatched tracks before each prediction.
    """

    def __init__(self, motion: Motion, decay: Decay = no_decay) -> None:
        self._motion, self._decay = motion, decay

    def start(self, x: F64, P: F64) -> None:
        """Return None: there are no modes."""

    def predict(
        self, records: Sequence[TrackRecord], dt_s: float, noise_factor: float = 1.0
    ) -> list[FilterState]:
        """Return the states of tracks dt_s seconds later, see `PositionMotion.predict`."""
        unmatched = np.array([t.missed > 0 for t in records])
        x, P = self._decay(*stack(records), unmatched, dt_s)
        states = self._motion.predict(x, P, dt_s, noise_factor)
        return [FilterState(*s) for s in zip(*states, strict=True)]

    def update(self, records: Sequence[TrackRecord], z: F64, R: F64) -> list[FilterState]:
        """Return states updated with one measurement (Nxm, noise Nxmxm) each."""
        x, P = kalman.update(*stack(records), z, R)
        return [FilterState(*s) for s in zip(x, P, strict=True)]


class Imm:
    """Interacting multiple models: one for standing people and one for walking people.

    A single model turns errors of position into velocities of standing people. So two filters run
    in parallel, weighted by the likelihood of the measurements; the estimate is their mean. `decay`
    applies to the walking mode. Source: docs/method.md, section 16 [Blom 1988].
    """

    def __init__(self, motion: PositionMotion, decay: Decay = no_decay) -> None:
        self._motion, self._decay = motion, decay
        velocity = STANDING_SIGMA_MPS**2 * (np.eye(6) - IS_POSITION) * np.eye(6)
        self._still = np.array([velocity, np.zeros((6, 6))])  # added covariance, by mode
        level, up = WALKING_SIGMA_MPS**2, STANDING_SIGMA_MPS**2
        self._begins_to_walk = np.diag([0.0, 0.0, 0.0, level, level, up])

    def start(self, x: F64, P: F64) -> ImmState:
        """Initialise both modes with a state (6), covariance (6x6) and stationary probabilities.

        New tracks are usually walking. With equal probabilities their velocities would stay near 0
        for half a second.
        """
        mean_times_s = np.array([STANDING_S, WALKING_S])
        return ImmState(np.array([x, x]), np.array([P, P]), mean_times_s / mean_times_s.sum())

    def predict(
        self, records: Sequence[TrackRecord], dt_s: float, noise_factor: float = 1.0
    ) -> list[FilterState]:
        """Return the states of tracks dt_s seconds later, see `PositionMotion.predict`."""
        unmatched = np.array([t.missed > 0 for t in records])
        modes = self.predict_modes(*self._modes(records), unmatched, dt_s, noise_factor)
        return self.means(*modes)

    def update(self, records: Sequence[TrackRecord], z: F64, R: F64) -> list[FilterState]:
        """Return states updated with one measurement (Nx3, noise Nx3x3) each."""
        return self.means(*self.update_modes(*self._modes(records), z, R))

    def predict_modes(
        self,
        x: F64,
        P: F64,
        probability: F64,
        unmatched: BOOL,
        dt_s: float,
        noise_factor: float = 1.0,
    ) -> tuple[F64, F64, F64]:
        """Mix the modes of N tracks by their transitions, and predict dt_s seconds ahead.

        States are Nx2x6, covariances Nx2x6x6 and probabilities Nx2.
        """
        stop, start = (-math.expm1(-dt_s / s) for s in (WALKING_S, STANDING_S))
        transition = np.array([[1 - start, start], [stop, 1 - stop]])
        x, P, probability = imm.mix(x, P, probability, transition)
        walking = self._decay(x[:, WALKING], P[:, WALKING], unmatched, dt_s)
        x[:, WALKING], P[:, WALKING] = self._motion.predict(*walking, dt_s, noise_factor)
        self._stand(x[:, STANDING], P[:, STANDING], dt_s, noise_factor)
        return x, P, probability

    def update_modes(
        self, x: F64, P: F64, probability: F64, z: F64, R: F64
    ) -> tuple[F64, F64, F64]:
        """Update with one measurement (3) each, and weigh the modes by its likelihood."""
        z, R = z[:, None], R[:, None]
        y, S = kalman.innovation(x, P, z, R)
        inverse = inverted(S)
        d_m2 = kalman.squared_lengths(y, inverse)
        x, P = kalman.corrected(x, P, y, R, inverse)
        return x, P, imm.weighed(probability, d_m2, np.linalg.slogdet(S)[1])

    def means(self, x: F64, P: F64, probability: F64) -> list[FilterState]:
        """Return the mean states and covariances of N tracks, with their modes."""
        mean, covariance = imm.moments(probability[:, None], x, P * OWN + self._still)
        modes = map(ImmState, x, P, probability)
        return list(map(FilterState, mean[:, 0], covariance[:, 0], modes))

    def _modes(self, records: Sequence[TrackRecord]) -> tuple[F64, F64, F64]:
        states = [t.imm or self.start(t.x, t.P) for t in records]
        return (
            np.array([s.x for s in states]),
            np.array([s.P for s in states]),
            np.array([s.mode_probability for s in states]),
        )

    def _stand(self, x: F64, P: F64, dt_s: float, noise_factor: float) -> None:
        """Predict the standing mode: velocity 0 with the variance of starting to walk."""
        drift_m2 = noise_factor * STANDING_SIGMA_MPS**2 * dt_s**2 + DRIFT_M2PS * dt_s
        x[:, 3:] = 0.0
        P *= IS_POSITION
        P += drift_m2 * ON_POSITION + self._begins_to_walk


def inverted(S: F64) -> F64:
    """Return the inverses of matrices."""
    return np.asarray(np.linalg.inv(S), np.float64)


StateFilter: TypeAlias = KalmanFilter | Imm
