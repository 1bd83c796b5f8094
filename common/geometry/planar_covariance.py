"""Uncertainty of the pose of a base on a plane, as reported by its odometry."""

from dataclasses import dataclass

import numpy as np

from people4d.messages import F64

ASYMMETRY_MAX = 1e-6  # maximum asymmetry and negative eigenvalue, relative to the largest element


@dataclass(frozen=True)
class PlanarCovariance:
    """Covariance of a pose since the origin of its frame."""

    matrix: F64  # [m, rad] 3x3 of x, y and theta, with the axes of that frame
    position_m: F64  # [m] 2, position of the base in that frame

    def growth(self, before: "PlanarCovariance") -> F64 | None:
        """Return the covariance (3x3) of the motion since another pose; None if unknown.

        An earlier error of the angle has moved the base sideways: P = J P_before J^T + Q, with J =
        d(x, y, theta) / d(x, y, theta)_before. A constant covariance is a setting of a driver,
        without information on the motion.
        """
        if np.array_equal(self.matrix, before.matrix):
            return None
        dx, dy = self.position_m - before.position_m
        J = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        values, vectors = np.linalg.eigh(self.matrix - J @ before.matrix @ J.T)
        growth: F64 = (vectors * np.maximum(values, 0.0)) @ vectors.T
        return growth

    def in_frame(self, target_from_frame: F64) -> "PlanarCovariance":
        """Return the covariance in another frame (4x4), both with z up."""
        position_m = target_from_frame[:2, :2] @ self.position_m + target_from_frame[:2, 3]
        return PlanarCovariance(turned(self.matrix, target_from_frame), position_m)


def turned(covariance: F64, target_from_frame: F64) -> F64:
    """Return a covariance (3x3) of x, y and theta with the axes of another frame (4x4)."""
    rotation = np.eye(3)
    rotation[:2, :2] = target_from_frame[:2, :2]
    result: F64 = rotation @ covariance @ rotation.T
    return result


def is_plausible(covariance: F64, sigma_max_m: float, sigma_max_rad: float) -> bool:
    """Check that a covariance (3x3) of x, y, theta is valid, and not a code for an unknown pose.

    Drivers use zeros, negative or huge numbers for unknown poses.
    """
    variances, scale = np.diag(covariance), float(np.abs(covariance).max())
    limits = np.square([sigma_max_m, sigma_max_m, sigma_max_rad])
    if not np.all(np.isfinite(covariance)) or not np.all((variances > 0) & (variances <= limits)):
        return False
    if np.abs(covariance - covariance.T).max() > ASYMMETRY_MAX * scale:
        return False
    return bool(np.linalg.eigvalsh(covariance).min() >= -ASYMMETRY_MAX * scale)
