"""Interacting multiple models (IMM): a filter for standing people and one for walking people.

A person who stands has no velocity, but a single model turns every error of the measured position
into one. So two filters run in parallel, each as probable as it predicts the measurements, with
transitions between them at a rate; the estimate is their mean. Source: docs/method.md, section 16
[Blom 1988].
"""

import math
from collections.abc import Sequence

import numpy as np

from people4d.messages import F64
from services.tracker.config import ImmConfig
from services.tracker.motion import kalman
from services.tracker.motion.motion import PositionMotion
from services.tracker.motion.state_filter import Decay, FilterState, no_decay
from services.tracker.motion.track_record import BOOL, ImmState, TrackRecord

STANDING, WALKING = 0, 1  # modes
PROBABILITY_MIN = 1e-6  # of each mode


class Imm:
    """The filters of many tracks, N at once.

    Args:
        motion: Motion model of walking people.
        config: Motion model of standing people, and the rates of transition.
        decay: Applied to the velocities of unmatched tracks in the walking mode.
    """

    def __init__(self, motion: PositionMotion, config: ImmConfig, decay: Decay = no_decay) -> None:
        self._motion = motion
        self._config = config
        self._decay = decay

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
        x, P, probability = _stack(states)
        config = self._config
        stop, start = (-math.expm1(-dt_s / s) for s in (config.walking_s, config.standing_s))
        transition = np.array([[1 - start, start], [stop, 1 - stop]])
        x, P, probability = mix(x, P, probability, transition)
        walking = self._decay(x[:, WALKING], P[:, WALKING], unmatched, dt_s)
        walking_x, walking_P = self._motion.predict(*walking, dt_s)
        standing_x, standing_P = self._stand(x[:, STANDING], P[:, STANDING], dt_s)
        x, P = np.stack([standing_x, walking_x], 1), np.stack([standing_P, walking_P], 1)
        return _split(x, P, probability)

    def update_modes(self, states: Sequence[ImmState], z: F64, R: F64) -> list[ImmState]:
        """Update with one measurement (3) each, and weigh the modes by its likelihood."""
        x, P, probability = _stack(states)
        z, R, H = z[:, None], R[:, None], self._motion.H
        logs = log_likelihood(*kalman.innovation(x, P, z, H, R / self._config.noise_divisor))
        x, P = kalman.update(x, P, z, H, R)
        logs -= logs.max(axis=1, keepdims=True)
        probability = probability * np.exp(logs)
        probability /= probability.sum(axis=1, keepdims=True)
        probability = np.maximum(probability, PROBABILITY_MIN)
        return _split(x, P, probability / probability.sum(axis=1, keepdims=True))

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
    """Return the mixed initial conditions of each mode.

    Args:
        x: Nx2x6 states.
        P: Nx2x6x6 covariances.
        probability: Nx2, of each mode.
        transition: 2x2, probability of a transition from row to column.

    Returns:
        States, covariances and mode probabilities, as they are before the step.
    """
    joint = probability[:, :, None] * transition  # N, from, to
    after = joint.sum(axis=1)
    weight = joint / after[:, None]
    mean = np.einsum("nij,nia->nja", weight, x)
    off = x[:, :, None] - mean[:, None]  # N, from, to, 6
    spread = P[:, :, None] + off[..., :, None] * off[..., None, :]
    return mean, np.einsum("nij,nijab->njab", weight, spread), after


def log_likelihood(y: F64, S: F64) -> F64:
    """Return the logarithm of the normal density, less a constant.

    Args:
        y: ...xm, innovations.
        S: ...xmxm, their covariances.
    """
    d2 = np.sum(y * np.linalg.solve(S, y[..., None])[..., 0], axis=-1)
    result: F64 = -0.5 * (d2 + np.linalg.slogdet(S)[1])
    return result


def _stack(states: Sequence[ImmState]) -> tuple[F64, F64, F64]:
    return (
        np.array([s.x for s in states]),
        np.array([s.P for s in states]),
        np.array([s.mode_probability for s in states]),
    )


def _split(x: F64, P: F64, probability: F64) -> list[ImmState]:
    return [ImmState(*one) for one in zip(x, P, probability, strict=True)]
