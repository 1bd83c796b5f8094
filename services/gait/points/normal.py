"""Normal distributions of positions in space, conditioned on pixels.

Dozens are computed in a frame, so the functions are compiled.

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
        """Return the squared Mahalanobis distance of a pixel (u, v) to the projected position."""
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
    inverse = np.linalg.inv(covariance)
    found = np.zeros(len(points_m))
    for k in range(len(points_m)):
        off = points_m[k] - mean_m
        for i in range(3):
            for j in range(3):
                found[k] += inverse[i, j] * off[i] * off[j]
    return found


@compiled
def _product(mean_m: F64, covariance: F64, other_m: F64, other: F64) -> tuple[F64, F64]:
    """Return mean and covariance of the product of two normal distributions."""
    gain = covariance @ np.linalg.inv(covariance + other)
    updated = covariance - gain @ covariance
    return mean_m + gain @ (other_m - mean_m), (updated + updated.T) / 2


@compiled
def _on_ray(mean_m: F64, covariance: F64, there_m: F64, sigma_m: float) -> tuple[F64, F64, float]:
    """Return a distribution given the ray through a point, and the squared distance of that ray.

    Args:
        mean_m: 3.
        covariance: 3x3.
        there_m: Point on the ray (3) at about the depth of the mean.
        sigma_m: Standard deviation of the ray in two directions at right angles to it.

    Returns:
        Mean, covariance, and the squared Mahalanobis distance of the ray to the mean.
    """
    x, y, z = there_m / np.sqrt((there_m**2).sum())
    level = np.sqrt(x * x + z * z)
    across = np.array(((z / level, 0.0, -x / level), (-x * y / level, level, -y * z / level)))
    shared = covariance @ across.T
    inverse = np.linalg.inv(across @ shared + sigma_m**2 * np.eye(2))
    off, gain = across @ (there_m - mean_m), shared @ inverse
    updated = covariance - gain @ shared.T
    return mean_m + gain @ off, (updated + updated.T) / 2, float(off @ inverse @ off)
