"""Normal distributions of positions in space, conditioned on pixels.

Filters of points compute dozens of them in a frame, so they are compiled.

Source: docs/method.md, section 19.
"""

from dataclasses import dataclass

import numpy as np

from common.compiled import compiled
from common.geometry.transforms import deproject
from people4d.messages import F64, CameraInfo

DEPTH_MIN_M = 0.3  # Minimum depth of a mean [m]


@dataclass(frozen=True)
class Normal:
    """Normal distribution of a position in the optical frame."""

    mean_m: F64  # 3
    covariance: F64  # 3x3

    def distances2(self, points_m: F64) -> F64:
        """Return the squared Mahalanobis distances of points, Nx3."""
        return squared_distances(points_m, self.mean_m, self.covariance)

    def fused(self, other: "Normal") -> "Normal":
        """Return the product of two distributions."""
        return Normal(*_product(self.mean_m, self.covariance, other.mean_m, other.covariance))

    def pixel_distance2(self, pixel: F64, sigma_px: float, info: CameraInfo) -> float:
        """Return the squared Mahalanobis distance of a pixel (u, v) to the position's."""
        return float(self._given_pixel(pixel, sigma_px, info)[2])

    def at_pixel(self, pixel: F64, sigma_px: float, info: CameraInfo) -> "Normal":
        """Return the distribution of a position that appears at a pixel (u, v)."""
        mean_m, covariance, _ = self._given_pixel(pixel, sigma_px, info)
        return Normal(mean_m, covariance)

    def on_ray(self, point_m: F64, sigma_px: float, info: CameraInfo) -> tuple["Normal", float]:
        """Return the distribution of a position on the ray through a point, 3.

        The second value is the squared Mahalanobis distance of the ray to the position.
        """
        mean_m, covariance, squared = self._given_ray(point_m, sigma_px, info)
        return Normal(mean_m, covariance), squared

    def _given_pixel(self, pixel: F64, sigma_px: float, info: CameraInfo) -> tuple[F64, F64, float]:
        return self._given_ray(deproject(pixel, 1.0, info)[0], sigma_px, info)

    def _given_ray(self, point_m: F64, sigma_px: float, info: CameraInfo) -> tuple[F64, F64, float]:
        depth_m = max(float(self.mean_m[2]), DEPTH_MIN_M)
        there_m = point_m * (depth_m / point_m[2])
        return _on_ray(self.mean_m, self.covariance, there_m, sigma_px * depth_m / info.fx)


@compiled
def squared_distances(points_m: F64, mean_m: F64, covariance: F64) -> F64:
    """Return squared Mahalanobis distances, N, of Nx3 points to a mean, 3, by a 3x3 covariance."""
    A = _inverse(covariance)
    found = np.empty(len(points_m))
    for k in range(len(points_m)):
        x, y, z = (
            points_m[k, 0] - mean_m[0],
            points_m[k, 1] - mean_m[1],
            points_m[k, 2] - mean_m[2],
        )
        found[k] = (
            A[0, 0] * x * x
            + A[1, 1] * y * y
            + A[2, 2] * z * z
            + 2 * (A[0, 1] * x * y + A[0, 2] * x * z + A[1, 2] * y * z)
        )
    return found


@compiled
def _inverse(A: F64) -> F64:
    """Return the inverse of a symmetric 3x3 matrix."""
    a, b, c, d, e, f = A[0, 0], A[0, 1], A[0, 2], A[1, 1], A[1, 2], A[2, 2]
    first, second, third = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * first + b * second + c * third
    found = np.empty((3, 3))
    found[0, 0] = first / determinant
    found[0, 1] = found[1, 0] = second / determinant
    found[0, 2] = found[2, 0] = third / determinant
    found[1, 1] = (a * f - c * c) / determinant
    found[1, 2] = found[2, 1] = (b * c - a * e) / determinant
    found[2, 2] = (a * d - b * b) / determinant
    return found


@compiled
def _product(mean_m: F64, covariance: F64, other_m: F64, other: F64) -> tuple[F64, F64]:
    """Return mean and covariance of the product of two normal distributions."""
    inverse = _inverse(covariance + other)
    gain, mean, updated = np.zeros((3, 3)), mean_m.copy(), covariance.copy()
    for i in range(3):
        for j in range(3):
            for k in range(3):
                gain[i, j] += covariance[i, k] * inverse[k, j]
    for i in range(3):
        for j in range(3):
            mean[i] += gain[i, j] * (other_m[j] - mean_m[j])
            for k in range(3):
                updated[i, j] -= gain[i, k] * covariance[k, j]
    return mean, (updated + updated.T) / 2


@compiled
def _on_ray(mean_m: F64, covariance: F64, there_m: F64, sigma_m: float) -> tuple[F64, F64, float]:
    """Return a distribution given the ray through a point, and the squared distance of that ray.

    Args:
        mean_m: 3.
        covariance: 3x3.
        there_m: 3, about as deep as the mean.
        sigma_m: Standard deviation of the ray in two directions at right angles to it.

    Returns:
        Mean, covariance, and the squared Mahalanobis distance of the ray to the mean.
    """
    size = np.sqrt(there_m[0] ** 2 + there_m[1] ** 2 + there_m[2] ** 2)
    x, y, z = there_m[0] / size, there_m[1] / size, there_m[2] / size
    level = np.sqrt(x * x + z * z)
    across = np.empty((2, 3))
    across[0, 0], across[0, 1], across[0, 2] = z / level, 0.0, -x / level
    across[1, 0], across[1, 1], across[1, 2] = -x * y / level, level, -y * z / level
    shared, off = np.zeros((3, 2)), np.zeros(2)
    for j in range(2):
        for i in range(3):
            off[j] += across[j, i] * (there_m[i] - mean_m[i])
            for k in range(3):
                shared[i, j] += covariance[i, k] * across[j, k]
    a = d = sigma_m * sigma_m
    b = 0.0
    for i in range(3):
        a += across[0, i] * shared[i, 0]
        b += across[0, i] * shared[i, 1]
        d += across[1, i] * shared[i, 1]
    determinant = a * d - b * b
    mean, updated = mean_m.copy(), covariance.copy()
    for i in range(3):
        first = (d * shared[i, 0] - b * shared[i, 1]) / determinant
        second = (a * shared[i, 1] - b * shared[i, 0]) / determinant
        mean[i] += first * off[0] + second * off[1]
        for j in range(3):
            updated[i, j] -= first * shared[j, 0] + second * shared[j, 1]
    squared = (d * off[0] ** 2 - 2 * b * off[0] * off[1] + a * off[1] ** 2) / determinant
    return mean, (updated + updated.T) / 2, squared
