"""Filters of the states of tracks: a Kalman filter, with a velocity decay for unmatched tracks."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from people4d.messages import F64
from services.tracker.config import OcclusionConfig
from services.tracker.motion import kalman
from services.tracker.motion.motion import Motion
from services.tracker.motion.track_record import BOOL, ImmState, TrackRecord, stack

# From states (Nxn), covariances (Nxnxn), unmatched tracks (N) and a time step in seconds.
Decay: TypeAlias = Callable[[F64, F64, BOOL, float], tuple[F64, F64]]


class FilterState(NamedTuple):
    """The state of one track after a step."""

    x: F64
    P: F64
    imm: ImmState | None = None


class StateFilter(Protocol):
    """Prediction and update of the states of tracks."""

    def start(self, x: F64, P: F64) -> ImmState | None:
        """Return the state of the motion models of a new track; None: there is one model only."""
        ...

    def predict(self, records: Sequence[TrackRecord], dt_s: float) -> list[FilterState]:
        """Return the states of tracks dt_s seconds later."""
        ...

    def update(self, records: Sequence[TrackRecord], z: F64, R: F64) -> list[FilterState]:
        """Return states updated with one measurement (Nxm, noise Nxmxm) each."""
        ...


def no_decay(x: F64, P: F64, unmatched: BOOL, dt_s: float) -> tuple[F64, F64]:  # noqa: ARG001
    """Keep the velocity of unmatched tracks."""
    return x, P


class VelocityDecay:
    """Decay of the velocity of unmatched tracks, while its uncertainty recovers.

    An Ornstein-Uhlenbeck process: over dt the velocity shrinks by k = exp(-dt / tau), and
    (1 - k^2) sigma^2 is added to its variance, so that the position's uncertainty keeps growing
    while the predicted position comes to rest.

    Args:
        config: tau and sigma.
        velocity: Indices of the velocities in the state.
    """

    def __init__(self, config: OcclusionConfig, velocity: Sequence[int]) -> None:
        self._config = config
        self._velocity = np.array(velocity)

    def __call__(self, x: F64, P: F64, unmatched: BOOL, dt_s: float) -> tuple[F64, F64]:
        """Return states (Nxn) and covariances (Nxnxn) after the decay."""
        if not unmatched.any():
            return x, P
        k = math.exp(-dt_s / self._config.velocity_decay_s)
        rows = unmatched.nonzero()[0]
        factor = np.ones_like(x)
        factor[np.ix_(rows, self._velocity)] = k
        variance = np.zeros_like(x)
        level = self._velocity[:2]  # walking people do not move up or down
        variance[np.ix_(rows, level)] = (1 - k**2) * self._config.walking_sigma_mps**2
        P = factor[:, :, None] * P * factor[:, None]
        return factor * x, P + variance[:, :, None] * np.eye(x.shape[1])


class KalmanFilter:
    """One motion model.

    Args:
        motion: Motion and measurement model.
        decay: Applied to the velocities of unmatched tracks before each prediction.
    """

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
