"""The linear Kalman filter, for one track or for a stack of them.

Shapes are for N tracks with n state variables, the first m measured (H = [I 0]): states x (Nxn),
covariances P (Nxnxn), measurements z (Nxm) and their noise R (Nxmxm). Leading axes broadcast, so
the same functions serve one track. Source: docs/method.md, section 3 [Kalman 1960].
"""

from functools import cache
from typing import TypeVar

import numpy as np

from people4d.messages import F64

A = TypeVar("A", float, F64)


def predict(x: F64, P: F64, F: F64, Q: F64) -> tuple[F64, F64]:
    """Return states and covariances predicted by F (nxn) with process noise Q (nxn or Nxnxn)."""
    return x @ F.T, F @ P @ F.T + Q


def innovation(x: F64, P: F64, z: F64, R: F64) -> tuple[F64, F64]:
    """Return measurements less predictions (Nxm) and its covariance S (Nxmxm)."""
    m = z.shape[-1]
    return z - x[..., :m], P[..., :m, :m] + R


def squared_lengths(y: F64, inverse: F64) -> F64:
    """Return the squared Mahalanobis distances (N) of y (Nxm) by inverse covariances (Nxmxm)."""
    lengths: F64 = np.add.reduce(y * (inverse @ y[..., None])[..., 0], axis=-1)
    return lengths


def gate(x: F64, P: F64, z: F64, R: F64) -> F64:
    """Return the squared Mahalanobis distances (NxM) of N predictions and M measurements.

    The innovation covariances S of all pairs are factorised together (S = L D L^T), element by
    element: a solver for each pair takes twelve times as long for 200 people.
    """
    m = z.shape[-1]
    y = [z[:, i] - x[:, i, None] for i in range(m)]
    S = {(i, j): P[:, i, j, None] + R[:, i, j] for i in range(m) for j in range(i, m)}
    distances = np.zeros((len(x), len(z)))
    for i in range(m):
        distances += y[i] * y[i] / S[i, i]
        for j in range(i + 1, m):
            factor = S[i, j] / S[i, i]
            y[j] = y[j] - factor * y[i]
            for k in range(j, m):
                S[j, k] = S[j, k] - factor * S[i, k]
    return distances


def update(x: F64, P: F64, z: F64, R: F64) -> tuple[F64, F64]:
    """Return predicted states and covariances updated with one measurement each.

    The covariance follows Joseph's form, which keeps it symmetric and positive definite.
    """
    y, S = innovation(x, P, z, R)
    return corrected(x, P, y, R, np.asarray(np.linalg.inv(S), np.float64))


def corrected(x: F64, P: F64, y: F64, R: F64, inverse: F64) -> tuple[F64, F64]:
    """Return updated states and covariances from innovations (Nxm) and inverse S (Nxmxm)."""
    m = y.shape[-1]
    K = P[..., :m] @ inverse
    A = np.empty_like(P)  # I - K H
    A[...] = _identity(P.shape[-1])
    A[..., :m] -= K
    updated = A @ P @ A.swapaxes(-1, -2) + K @ R @ K.swapaxes(-1, -2)
    x = x + (K @ y[..., None])[..., 0]
    return x, (updated + updated.swapaxes(-1, -2)) / 2


_identity = cache(np.eye)


def acceleration_noise(dt_s: float, sigma_a: A) -> tuple[A, A, A]:
    """Return Q of piecewise-constant white acceleration: position, cross term and velocity.

    Args:
        dt_s: Time step in seconds.
        sigma_a: Standard deviation of the acceleration, one number or an array.

    Returns:
        sigma_a^2 dt^4/4, sigma_a^2 dt^3/2 and sigma_a^2 dt^2, in the shape of sigma_a.
    """
    variance = sigma_a * sigma_a
    return variance * dt_s**4 / 4, variance * dt_s**3 / 2, variance * dt_s**2
