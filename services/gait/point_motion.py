"""How one point moves in space: a Kalman filter of constant velocity."""

import numpy as np

from common.messages import F64

H = np.eye(3, 6)


class PointMotion:
    """Position and velocity of a point.

    Args:
        position_m: 3, where it is first.
        noise_m2: 3x3, covariance of that.
        speed_mps: Standard deviation of the velocity, which is not known at first.
        acceleration_mps2: Standard deviation of the acceleration.

    Source: method book section 3.
    """

    def __init__(
        self, position_m: F64, noise_m2: F64, speed_mps: float, acceleration_mps2: float
    ) -> None:
        self.state: F64 = np.concatenate([position_m, np.zeros(3)])
        self.covariance: F64 = np.zeros((6, 6))
        self.covariance[:3, :3] = noise_m2
        self.covariance[3:, 3:] = speed_mps**2 * np.eye(3)
        self._acceleration = acceleration_mps2

    @property
    def position_m(self) -> F64:
        """3."""
        return self.state[:3]

    @property
    def spread_m(self) -> float:
        """Standard deviation of the position where it is largest."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    def predict(self, dt_s: float) -> None:
        """Move ahead in time."""
        self.state, self.covariance = self.ahead(dt_s)

    def ahead(self, dt_s: float) -> tuple[F64, F64]:
        """Return state, 6, and covariance, 6x6, after some time."""
        step = np.eye(6)
        step[:3, 3:] = dt_s * np.eye(3)
        push = np.concatenate([dt_s**2 / 2 * np.eye(3), dt_s * np.eye(3)])
        noise = self._acceleration**2 * push @ push.T
        return step @ self.state, step @ self.covariance @ step.T + noise

    def distances2(self, points_m: F64, noise_m2: F64) -> F64:
        """Return squared Mahalanobis distances of Nx3 measured points to the prediction, N."""
        away = points_m - self.position_m
        S = self.covariance[:3, :3] + noise_m2
        return np.asarray(np.einsum("ni,ni->n", away, np.linalg.solve(S, away.T).T))

    def correct(self, point_m: F64, noise_m2: F64) -> None:
        """Take in a measured point, 3, and its covariance, 3x3."""
        S = self.covariance[:3, :3] + noise_m2
        gain = np.linalg.solve(S, self.covariance[:3]).T
        self.state = self.state + gain @ (point_m - self.position_m)
        left = np.eye(6) - gain @ H
        # Joseph's form stays symmetric and positive definite.
        self.covariance = left @ self.covariance @ left.T + gain @ noise_m2 @ gain.T
