"""The linear Kalman filter, for one track or for a stack of them.

Shapes are written for N tracks with n state variables and m measured ones. Leading axes broadcast,
so the same functions serve one track. Source: docs/method.md, section 3 [Kalman 1960].
"""

import numpy as np

from people4d.messages import F64


def predict(x: F64, P: F64, F: F64, Q: F64) -> tuple[F64, F64]:
    """Move states ahead in time.

    Args:
        x: Nxn states.
        P: Nxnxn covariances.
        F: nxn transition.
        Q: nxn or Nxnxn process noise.

    Returns:
        Predicted states and covariances.
    """
    return x @ F.T, F @ P @ F.T + Q


def innovation(x: F64, P: F64, z: F64, H: F64, R: F64) -> tuple[F64, F64]:
    """Return measurements less predictions (Nxm) and its covariance S (Nxmxm)."""
    return z - x @ H.T, H @ P @ H.T + R


def gating_distances(x: F64, P: F64, z: F64, H: F64, R: F64) -> F64:
    """Return the squared Mahalanobis distance of each track and each of M measurements.

    Args:
        x: Nxn predicted states.
        P: Nxnxn predicted covariances.
        z: Mxm measurements.
        H: mxn measurement matrix.
        R: Mxmxm measurement noise.

    Returns:
        NxM, squared distances.
    """
    y, S = innovation(x[:, None], P[:, None], z[None], H, R[None])
    weighted = np.linalg.solve(S, y[..., None])[..., 0]
    distances: F64 = np.sum(y * weighted, axis=-1)
    return distances


def update(x: F64, P: F64, z: F64, H: F64, R: F64) -> tuple[F64, F64]:
    """Update predicted states with one measurement each.

    The covariance follows Joseph's form, which keeps it symmetric and positive definite.

    Args:
        x: Nxn predicted states.
        P: Nxnxn predicted covariances.
        z: Nxm measurements.
        H: mxn measurement matrix.
        R: Nxmxm measurement noise.

    Returns:
        Updated states and covariances.
    """
    y, S = innovation(x, P, z, H, R)
    K = np.linalg.solve(S, H @ P).swapaxes(-1, -2)
    A = np.eye(P.shape[-1]) - K @ H
    updated = A @ P @ A.swapaxes(-1, -2) + K @ R @ K.swapaxes(-1, -2)
    x = x + (K @ y[..., None])[..., 0]
    return x, (updated + updated.swapaxes(-1, -2)) / 2
