"""Filters of the states of tracks: one motion model, or two interacting ones.

The velocity of unmatched tracks may decay.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from common import kalman
from people4d.messages import F64
from services.tracker.config import ImmConfig, OcclusionConfig
from services.tracker.motion.motion import Motion, PositionMotion
from services.tracker.motion.track_record import BOOL, ImmState, TrackRecord, stack

STANDING, WALKING = 0, 1  # modes
PROBABILITY_MIN = 1e-6  # of each mode

# From states (Nxn), covariances (Nxnxn), unmatched tracks (N) and a time step in seconds.
Decay: TypeAlias = Callable[[F64, F64, BOOL, float], tuple[F64, F64]]


class FilterState(NamedTuple):
    """The state of one track after a step."""

    x: F64
    P: F64
    imm: ImmState | None = None


def no_decay(x: F64, P: F64, unmatched: BOOL, dt_s: float) -> tuple[F64, F64]:  # noqa: ARG001
    """Keep the velocity of unmatched tracks."""
    return x, P


def decay_velocity(
    x: F64, P: F64, unmatched: BOOL, dt_s: float, config: OcclusionConfig
) -> tuple[F64, F64]:
    """Return states (Nx6) and covariances (Nx6x6) with decayed velocities of unmatched tracks.

    An Ornstein-Uhlenbeck process: over dt the velocity shrinks by k = exp(-dt / tau), and
    (1 - k^2) sigma^2 is added to its variance, so that the position's uncertainty keeps growing
    while the predicted position comes to rest.
    """
    if not unmatched.any():
        return x, P
    k = math.exp(-dt_s / config.velocity_decay_s)
    factor, variance = np.ones_like(x), np.zeros_like(x)
    factor[unmatched, 3:] = k
    # Walking people do not move up or down.
    variance[unmatched, 3:5] = (1 - k**2) * config.walking_sigma_mps**2
    P = factor[:, :, None] * P * factor[:, None]
    return factor * x, P + variance[:, :, None] * np.eye(x.shape[1])


class KalmanFilter:
    """One motion model; `decay` is applied to unmatched tracks before each prediction."""

    def __init__(self, motion: Motion, decay: Decay = no_decay) -> None:
        self._motion, self._decay = motion, decay

    def start(self, x: F64, P: F64) -> None:
        """Return None: the state has one model only."""

    def predict(self, records: Sequence[TrackRecord], dt_s: float) -> list[FilterState]:
        """Return the states of tracks dt_s seconds later."""
        unmatched = np.array([t.missed > 0 for t in records])
        x, P = self._decay(*stack(records), unmatched, dt_s)
        return [FilterState(*s) for s in zip(*self._motion.predict(x, P, dt_s), strict=True)]

    def update(self, records: Sequence[TrackRecord], z: F64, R: F64) -> list[FilterState]:
        """Return states updated with one measurement (Nxm, noise Nxmxm) each."""
        states = kalman.update(*stack(records), z, self._motion.H, R)
        return [FilterState(*s) for s in zip(*states, strict=True)]


class Imm:
    """Interacting multiple models: one for standing people and one for walking people.

    A person who stands has no velocity, but a single model turns every error of the measured
    position into one. So two filters run in parallel, each as probable as it predicts the
    measurements, with transitions between them at a rate; the estimate is their mean. `decay`
    applies to the walking mode. Source: docs/method.md, section 16 [Blom 1988].
    """

    def __init__(self, motion: PositionMotion, config: ImmConfig, decay: Decay = no_decay) -> None:
        self._motion, self._config, self._decay = motion, config, decay

    def start(self, x: F64, P: F64) -> ImmState:
        """Begin with one state (6) and covariance (6x6): both modes are equally probable."""
        return ImmState(np.array([x, x]), np.array([P, P]), np.array([0.5, 0.5]))

    def predict(self, records: Sequence[TrackRecord], dt_s: float) -> list[FilterState]:
        """Return the states of tracks dt_s seconds later."""
        unmatched = np.array([t.missed > 0 for t in records])
        return self._means(self.predict_modes(self._states(records), unmatched, dt_s))

    def update(self, records: Sequence[TrackRecord], z: F64, R: F64) -> list[FilterState]:
        """Return states updated with one measurement (Nx3, noise Nx3x3) each."""
        return self._means(self.update_modes(self._states(records), z, R))

    def predict_modes(
        self, states: Sequence[ImmState], unmatched: BOOL, dt_s: float
    ) -> list[ImmState]:
        """Mix the modes of N tracks by their transitions and move each on for dt_s seconds."""
        x, P, probability = _columns(states)
        config = self._config
        stop, start = (-math.expm1(-dt_s / s) for s in (config.walking_s, config.standing_s))
        transition = np.array([[1 - start, start], [stop, 1 - stop]])
        x, P, probability = mix(x, P, probability, transition)
        walking = self._decay(x[:, WALKING], P[:, WALKING], unmatched, dt_s)
        walking_x, walking_P = self._motion.predict(*walking, dt_s)
        standing_x, standing_P = self._stand(x[:, STANDING], P[:, STANDING], dt_s)
        x, P = np.stack([standing_x, walking_x], 1), np.stack([standing_P, walking_P], 1)
        return _states_of(x, P, probability)

    def update_modes(self, states: Sequence[ImmState], z: F64, R: F64) -> list[ImmState]:
        """Update with one measurement (3) each, and weigh the modes by its likelihood."""
        x, P, probability = _columns(states)
        z, R, H = z[:, None], R[:, None], self._motion.H
        logs = log_likelihood(*kalman.innovation(x, P, z, H, R / self._config.noise_divisor))
        x, P = kalman.update(x, P, z, H, R)
        logs -= logs.max(axis=1, keepdims=True)
        probability = probability * np.exp(logs)
        probability /= probability.sum(axis=1, keepdims=True)
        probability = np.maximum(probability, PROBABILITY_MIN)
        return _states_of(x, P, probability / probability.sum(axis=1, keepdims=True))

    def mean(self, state: ImmState) -> tuple[F64, F64]:
        """Return the mean state (6) and covariance (6x6) of both modes."""
        P = state.P.copy()
        P[STANDING, 3:] = P[STANDING, :, 3:] = 0.0
        P[STANDING, [3, 4, 5], [3, 4, 5]] = self._config.standing_sigma_mps**2
        x = state.mode_probability @ state.x
        off = state.x - x
        spread = P + off[:, :, None] * off[:, None]
        return x, np.einsum("j,jab->ab", state.mode_probability, spread)

    def _states(self, records: Sequence[TrackRecord]) -> list[ImmState]:
        return [t.imm or self.start(t.x, t.P) for t in records]

    def _means(self, states: Sequence[ImmState]) -> list[FilterState]:
        return [FilterState(*self.mean(state), state) for state in states]

    def _stand(self, x: F64, P: F64, dt_s: float) -> tuple[F64, F64]:
        """Stay, with a velocity of 0 that has the variance of a person who begins to walk."""
        x, P, config = x.copy(), P.copy(), self._config
        x[:, 3:] = 0.0
        P[:, 3:] = P[:, :, 3:] = 0.0
        position, level = [0, 1, 2], [3, 4]
        P[:, position, position] += (
            config.standing_sigma_mps**2 * dt_s**2 + config.drift_m2ps * dt_s
        )
        P[:, level, level] = config.walking_sigma_mps**2
        P[:, 5, 5] = config.standing_sigma_mps**2
        return x, P


def mix(x: F64, P: F64, probability: F64, transition: F64) -> tuple[F64, F64, F64]:
    """Return the mixed initial states (Nx2x6), covariances and probabilities (Nx2) of the modes.

    Element i, j of `transition` is the probability of a transition from mode i to mode j.
    """
    joint = probability[:, :, None] * transition  # N, from, to
    after = joint.sum(axis=1)
    weight = joint / after[:, None]
    mean = np.einsum("nij,nia->nja", weight, x)
    off = x[:, :, None] - mean[:, None]  # N, from, to, 6
    spread = P[:, :, None] + off[..., :, None] * off[..., None, :]
    return mean, np.einsum("nij,nijab->njab", weight, spread), after


def log_likelihood(y: F64, S: F64) -> F64:
    """Return log-densities, less a constant, of innovations y (...xm) with covariances S."""
    d2 = np.sum(y * np.linalg.solve(S, y[..., None])[..., 0], axis=-1)
    result: F64 = -0.5 * (d2 + np.linalg.slogdet(S)[1])
    return result


def _columns(states: Sequence[ImmState]) -> tuple[F64, F64, F64]:
    x, P, probability = zip(*((s.x, s.P, s.mode_probability) for s in states), strict=True)
    return np.array(x), np.array(P), np.array(probability)


def _states_of(x: F64, P: F64, probability: F64) -> list[ImmState]:
    return [ImmState(*one) for one in zip(x, P, probability, strict=True)]


StateFilter: TypeAlias = KalmanFilter | Imm
