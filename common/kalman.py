"""The linear Kalman filter, for one track or for a stack of them.

Shapes are written for N tracks with n state variables and m measured ones: states x (Nxn),
covariances P (Nxnxn), measurements z (Nxm), their matrix H (mxn) and noise R (Nxmxm). Leading axes
broadcast, so the same functions serve one track. Source: docs/method.md, section 3 [Kalman 1960].
"""

import numpy as np
import numpy.typing as npt

from people4d.messages import F64


def predict(x: F64, P: F64, F: F64, Q: F64) -> tuple[F64, F64]:
    """Return states and covariances moved ahead by F (nxn) with process noise Q (nxn or Nxnxn)."""
    return x @ F.T, F @ P @ F.T + Q


def innovation(x: F64, P: F64, z: F64, H: F64, R: F64) -> tuple[F64, F64]:
    """Return measurements less predictions (Nxm) and its covariance S (Nxmxm)."""
    return z - x @ H.T, H @ P @ H.T + R


def gating_distances(x: F64, P: F64, z: F64, H: F64, R: F64) -> F64:
    """Return the squared Mahalanobis distances (NxM) of N predictions and M measurements."""
    y, S = innovation(x[:, None], P[:, None], z[None], H, R[None])
    weighted = np.linalg.solve(S, y[..., None])[..., 0]
    distances: F64 = np.sum(y * weighted, axis=-1)
    return distances


def update(x: F64, P: F64, z: F64, H: F64, R: F64) -> tuple[F64, F64]:
    """Return predicted states and covariances updated with one measurement each.

    The covariance follows Joseph's form, which keeps it symmetric and positive definite.
    """
    y, S = innovation(x, P, z, H, R)
    K = np.linalg.solve(S, H @ P).swapaxes(-1, -2)
    A = np.eye(P.shape[-1]) - K @ H
    updated = A @ P @ A.swapaxes(-1, -2) + K @ R @ K.swapaxes(-1, -2)
    x = x + (K @ y[..., None])[..., 0]
    return x, (updated + updated.swapaxes(-1, -2)) / 2


def acceleration_noise(dt_s: float, sigma_a: npt.ArrayLike) -> tuple[F64, F64, F64]:
    """Return Q of piecewise-constant white acceleration: position, cross term and velocity.

    Args:
        dt_s: Time step in seconds.
        sigma_a: Standard deviation of the acceleration, any shape.

    Returns:
        sigma_a^2 dt^4/4, sigma_a^2 dt^3/2 and sigma_a^2 dt^2, in the shape of sigma_a.
    """
    variance = np.square(np.asarray(sigma_a, np.float64))
    return variance * dt_s**4 / 4, variance * dt_s**3 / 2, variance * dt_s**2
