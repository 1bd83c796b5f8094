"""Yaw of tracks by a Kalman filter (docs/method.md, section 6 [PIC4SeR])."""

import math
from collections.abc import Sequence

import numpy as np

from common import kalman
from common.geometry.transforms import wrap
from people4d.messages import F64
from services.tracker.interface import Measurement
from services.tracker.motion.yaw import States, VelocityYaw, measured_rad

SIGMA_ACCELERATION_RADPS2 = 6.0  # standard deviation of the yaw acceleration [rad/s^2]
SIGMA_RAD = 0.35  # standard deviation of a measured yaw [rad]
SIGMA_START_RATE_RADPS = 1.0  # initial standard deviation of the turn rate [rad/s]


class KalmanYaw(VelocityYaw):
    """A Kalman filter on psi and dpsi, constant velocity, wrapped innovation.

    The first measurement initialises the state. A state is psi, dpsi, the variance of psi, the
    covariance of both and the variance of dpsi.
    """

    def predict(self, states: States, dt_s: float) -> list[F64 | None]:
        """Predict each yaw at its rate; the uncertainty grows."""
        noise = kalman.acceleration_noise(dt_s, SIGMA_ACCELERATION_RADPS2)
        return [None if s is None else predicted(s, dt_s, noise) for s in states]

    def update(self, states: States, measurements: Sequence[Measurement]) -> list[F64 | None]:
        """Update known states, and begin states with their first measurement."""
        return [
            self._updated(s, measured_rad(m)) for s, m in zip(states, measurements, strict=True)
        ]

    def read(self, state: F64 | None, velocity_mps: F64) -> float | None:  # noqa: ARG002
        """Return psi."""
        return None if state is None else wrap(float(state[0]))

    def _updated(self, state: F64 | None, yaw_rad: float) -> F64 | None:
        if math.isnan(yaw_rad):
            return state
        variance = SIGMA_RAD**2
        if state is None:
            rate_variance = SIGMA_START_RATE_RADPS**2
            return np.array([wrap(yaw_rad), 0.0, variance, 0.0, rate_variance])
        return corrected(state, yaw_rad, variance)


def predicted(state: F64, dt_s: float, noise: tuple[float, float, float]) -> F64:
    """Return a state moved ahead by [1 dt; 0 1], with elements of Q."""
    (psi, rate, p, c, v), (pp, pv, vv) = state.tolist(), noise
    p += dt_s * (2.0 * c + dt_s * v) + pp
    return np.array([wrap(psi + dt_s * rate), rate, p, c + dt_s * v + pv, v + vv])


def corrected(state: F64, yaw_rad: float, variance: float) -> F64:
    """Return a state updated with a measurement of psi with variance R, in Joseph's form."""
    psi, rate, p, c, v = state.tolist()
    y = wrap(yaw_rad - psi)
    k, m = p / (p + variance), c / (p + variance)
    cross = (1.0 - k) * (c - m * p) + k * m * variance
    p_after = (1.0 - k) ** 2 * p + k * k * variance
    v_after = v - 2.0 * m * c + m * m * (p + variance)
    return np.array([wrap(psi + k * y), rate + m * y, p_after, cross, v_after])
