"""Kalman filter of constant velocity of one point in space."""

import numpy as np

from common import kalman
from people4d.messages import F64
from services.gait.points.normal import squared_distances

EYE = np.eye(3)


class PointKalmanFilter:
    """Position (3, with covariance) and velocity of a point.

    `speed_mps` is the standard deviation of the initial velocity, which is 0. Source:
    docs/method.md, section 3.
    """

    def __init__(
        self, position_m: F64, noise_m2: F64, speed_mps: float, acceleration_mps2: float
    ) -> None:
        self.state: F64 = np.concatenate([position_m, np.zeros(3)])
        self.covariance: F64 = np.zeros((6, 6))
        self.covariance[:3, :3] = noise_m2
        self.covariance[3:, 3:] = speed_mps**2 * np.eye(3)
        self._acceleration = acceleration_mps2
        self._sigma_m: float | None = None  # computed on use

    @property
    def position_m(self) -> F64:
        """Position, 3."""
        return self.state[:3]

    @property
    def sigma_m(self) -> float:
        """Largest standard deviation of the position in any direction."""
        if self._sigma_m is None:
            self._sigma_m = float(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))
        return self._sigma_m

    def predict(self, dt_s: float) -> None:
        """Predict the state after some time."""
        self.state, self.covariance = self.predicted(dt_s)
        self._sigma_m = None

    def predicted(self, dt_s: float) -> tuple[F64, F64]:
        """Return state, 6, and covariance, 6x6, after some time."""
        P, (pp, pv, vv) = self.covariance, kalman.acceleration_noise(dt_s, self._acceleration)
        moved = P[:3, 3:] + dt_s * P[3:, 3:]
        ahead = np.empty((6, 6))
        ahead[:3, :3] = P[:3, :3] + dt_s * (P[3:, :3] + moved) + pp * EYE
        ahead[:3, 3:] = moved + pv * EYE
        ahead[3:, :3] = ahead[:3, 3:].T
        ahead[3:, 3:] = P[3:, 3:] + vv * EYE
        state = self.state.copy()
        state[:3] += dt_s * state[3:]
        return state, ahead

    def damp_velocity(self, velocity_mps: F64, ratio: float) -> None:
        """Move the velocity by a ratio of its difference to another, 3."""
        self.state[3:] += ratio * (velocity_mps - self.state[3:])

    def distances2(self, points_m: F64, noise_m2: F64) -> F64:
        """Return squared Mahalanobis distances of Nx3 measured points to the prediction, N."""
        return squared_distances(points_m, self.position_m, self.covariance[:3, :3] + noise_m2)

    def correct(self, point_m: F64, noise_m2: F64) -> None:
        """Update by a measured point, 3, and its covariance, 3x3."""
        self.state, self.covariance = kalman.update(self.state, self.covariance, point_m, noise_m2)
        self._sigma_m = None
