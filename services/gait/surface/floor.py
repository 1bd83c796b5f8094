"""The floor in a depth image: what feet stand on must not count as part of the body."""

from dataclasses import dataclass

import msgspec
import numpy as np

from common.compiled import compiled
from common.geometry.transforms import deproject
from people4d.messages import F32, F64, U16, CameraInfo


class FloorConfig(msgspec.Struct, frozen=True, kw_only=True):
    """How the floor is found and cut off."""

    cut: bool = True  # take what lies on the floor off bodies
    height_m: float = 0.035  # [m] above the floor up to which pixels belong to it; default
    noise_per_m2: float = 0.0025  # [m/m^2] depth noise by distance squared, counted twice
    tilt_max_deg: float = 40.0  # [deg] of the camera, by which the floor may be out of level
    every: int = 10  # frames, after which it is looked for again
    stride_px: int = 8  # [px] between pixels that are looked at
    share_min: float = 0.08  # of these pixels that lie on it; fewer: no floor is seen
    below_max: float = 0.04  # of them that may lie below it; more: it is a table

    def __post_init__(self) -> None:
        """Check numbers.

        Raises:
            ValueError: One is out of range.
        """
        if min(self.every, self.stride_px) < 1:
            raise ValueError(f"every, stride_px: expected >= 1, got {self.every}, {self.stride_px}")
        rest = (self.height_m, self.noise_per_m2, self.share_min, self.below_max)
        if not all(0 <= value < 1 for value in rest) or not 0 < self.tilt_max_deg < 90:
            raise ValueError(
                "height_m, noise_per_m2, share_min, below_max: expected 0 to below 1, "
                f"tilt_max_deg: 0 to 90, got {rest}, {self.tilt_max_deg}"
            )


@dataclass(frozen=True)
class Floor:
    """A plane, optical frame."""

    up: F64  # 3, unit length
    camera_m: float  # height of the camera above it

    def heights_m(self, points_m: F64) -> F64:
        """Return how high ...x3 points are above the floor."""
        return np.asarray(points_m @ self.up + self.camera_m)


class FloorFinder:
    """Finds the floor in depth images, and keeps it while it is hidden.

    Args:
        config: Thresholds.
        info: Calibration.
        seed: Of the random numbers.
    """

    def __init__(self, config: FloorConfig, info: CameraInfo, seed: int = 0) -> None:
        self._config = config
        self._generator = np.random.default_rng(seed)
        v, u = np.mgrid[: info.height, : info.width]
        pixels = np.column_stack([u.ravel(), v.ravel()])
        rays = deproject(pixels, np.ones(len(pixels)), info)
        self._rays: F32 = rays.T.reshape(3, info.height, info.width).astype(np.float32)
        self._far_m = info.max_depth_m
        self._frames = 0
        self.floor: Floor | None = None

    def update(self, depth_mm: U16) -> Floor | None:
        """Return the floor.

        Args:
            depth_mm: HxW, 0 = no reading.
        """
        if self._frames % self._config.every == 0 and depth_mm.shape == self._rays.shape[1:]:
            self.floor = self._found(depth_mm) or self.floor
        self._frames += 1
        return self.floor

    def without(self, depth_mm: U16, box_xyxy_px: F64) -> U16:
        """Return the depth image without what of a box lies on the floor or below."""
        config, floor = self._config, self.floor
        if floor is None or not config.cut or not np.all(np.isfinite(box_xyxy_px)):
            return depth_mm
        height, width = depth_mm.shape
        left, top, right, bottom = np.clip(box_xyxy_px, 0, [width, height] * 2).astype(int)
        rows, columns = slice(top, bottom + 1), slice(left, right + 1)
        cut = depth_mm.copy()
        plane = np.array([*floor.up, floor.camera_m], np.float32)
        limits = np.array([config.height_m, 2 * config.noise_per_m2], np.float32)
        _cut(cut[rows, columns], self._rays[:, rows, columns], plane, limits)
        return cut

    def _found(self, depth_mm: U16) -> Floor | None:
        stride = self._config.stride_px
        z = depth_mm[::stride, ::stride].astype(np.float64).ravel() / 1000
        seen = (z > 0) & (z <= self._far_m)
        points = (self._rays[:, ::stride, ::stride].reshape(3, -1)[:, seen] * z[seen]).T
        if len(points) < 50:
            return None
        limits = 0.02 + self._config.noise_per_m2 * z[seen] ** 2
        # The last floor is nearly always this one: planes are drawn only where it does not fit.
        guess = self._still(points, limits) or self._best(points, limits)
        if guess is None:
            return None
        for share in (1.0, 0.7, 0.5):  # ever less of the feet of walls counts as floor
            near = np.abs(guess.heights_m(points)) < share * limits
            fitted = self._fitted(points[near])
            guess = fitted if fitted is not None else guess
        return guess

    def _still(self, points: F64, limits: F64) -> Floor | None:
        """Return the last floor if enough points lie on it still."""
        if self.floor is None:
            return None
        heights = self.floor.heights_m(points)
        on, below = np.abs(heights) < limits, heights < -2 * limits
        fits = on.mean() >= self._config.share_min and below.mean() < self._config.below_max
        return self.floor if fits else None

    def _best(self, points: F64, limits: F64) -> Floor | None:
        """Return the plane through three points that most points lie on."""
        lower = points[points[:, 1] > 0]  # of the image, where floors are
        if len(lower) < 3:
            return None
        draws = self._generator.integers(0, len(lower), (100, 3))
        a, b, c = lower[draws].swapaxes(0, 1)
        normals = np.cross(b - a, c - a)
        sizes = np.linalg.norm(normals, axis=1)
        normals = normals / np.maximum(sizes, 1e-9)[:, None]
        normals *= np.where(normals[:, 1:2] > 0, -1.0, 1.0)  # y is down
        heights = points @ normals.T - np.einsum("ni,ni->n", a, normals)
        on = np.mean(np.abs(heights) < limits[:, None], axis=0)
        below = np.mean(heights < -2 * limits[:, None], axis=0)
        level = -normals[:, 1] > np.cos(np.radians(self._config.tilt_max_deg))
        ok = level & (sizes > 1e-6) & (below < self._config.below_max)
        best = int(np.argmax(np.where(ok, on, -1.0)))
        if not ok[best] or on[best] < self._config.share_min:
            return None
        return Floor(normals[best], float(-a[best] @ normals[best]))

    def _fitted(self, points: F64) -> Floor | None:
        if len(points) < 10:
            return None
        middle = points.mean(axis=0)
        up = np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 0]
        up = -up if up[1] > 0 else up
        if -up[1] < np.cos(np.radians(self._config.tilt_max_deg)):
            return None
        return Floor(up, float(-middle @ up))


@compiled
def _cut(depth_mm: U16, rays: F32, plane: F32, limits: F32) -> None:
    """Set pixels on a plane or below it to 0; the limit grows with the noise of the depth."""
    height, width = depth_mm.shape
    for row in range(height):
        for column in range(width):  # without branches: many pixels at once
            away = np.float32(0.001) * np.float32(depth_mm[row, column])
            rise = plane[0] * rays[0, row, column] + plane[1] * rays[1, row, column]
            rise += plane[2] * rays[2, row, column]
            limit = limits[0] + limits[1] * away * away * abs(rise)
            on = away * rise + plane[3] < limit
            depth_mm[row, column] = np.uint16(0) if on else depth_mm[row, column]
