"""Floor plane in a depth image, and its removal below people (docs/method.md, section 19)."""

from dataclasses import dataclass

import numpy as np

from common.compiled import compiled
from common.geometry.transforms import deproject
from people4d.messages import F32, F64, U16, CameraInfo

HEIGHT_M = 0.035  # Maximum height of pixels of the floor [m]
NOISE_PER_M2 = 0.0025  # Half of the depth noise by the distance squared [m/m^2]
TILT_MAX_DEG = 40.0  # Maximum tilt of the camera [deg]
PERIOD = 10  # Number of frames between detections
STRIDE_PX = 8  # Distance between sampled pixels [px]
SHARE_MIN = 0.08  # Minimum share of the samples on the floor
BELOW_MAX = 0.04  # Maximum share of the samples below the floor; a table has more


@dataclass(frozen=True)
class FloorPlane:
    """A plane in the optical frame."""

    up: F64  # 3, unit length
    camera_m: float  # height of the camera above the floor

    def heights_m(self, points_m: F64) -> F64:
        """Return the heights of points, ...x3, above the floor."""
        return np.asarray(points_m @ self.up + self.camera_m)


class FloorDetector:
    """Detects the floor in depth images; the last floor is kept while it is occluded.

    Source: docs/method.md, section 19 [Fischler 1981].
    """

    def __init__(self, info: CameraInfo, seed: int = 0) -> None:
        self._generator = np.random.default_rng(seed)
        v, u = np.mgrid[: info.height, : info.width]
        pixels = np.column_stack([u.ravel(), v.ravel()])
        rays = deproject(pixels, np.ones(len(pixels)), info)
        self._rays: F32 = rays.T.reshape(3, info.height, info.width).astype(np.float32)
        self._depth_max_m = info.max_depth_m
        self._frames = 0
        self.floor: FloorPlane | None = None

    def update_floor(self, depth_mm: U16) -> FloorPlane | None:
        """Return the floor, detected every few frames in a depth image, HxW, 0 = no reading."""
        if self._frames % PERIOD == 0 and depth_mm.shape == self._rays.shape[1:]:
            self.floor = self._detect(depth_mm) or self.floor
        self._frames += 1
        return self.floor

    def remove_floor(self, depth_mm: U16, box_xyxy_px: F64) -> U16:
        """Return the depth image without the pixels of a box on the floor or below."""
        floor = self.floor
        if floor is None or not np.all(np.isfinite(box_xyxy_px)):
            return depth_mm
        height, width = depth_mm.shape
        left, top, right, bottom = np.clip(box_xyxy_px, 0, [width, height] * 2).astype(int)
        rows, columns = slice(top, bottom + 1), slice(left, right + 1)
        cut = depth_mm.copy()
        plane = np.array([*floor.up, floor.camera_m], np.float32)
        limits = np.array([HEIGHT_M, 2 * NOISE_PER_M2], np.float32)
        _cut(cut[rows, columns], self._rays[:, rows, columns], plane, limits)
        return cut

    def _detect(self, depth_mm: U16) -> FloorPlane | None:
        z = depth_mm[::STRIDE_PX, ::STRIDE_PX].astype(np.float64).ravel() / 1000
        known = (z > 0) & (z <= self._depth_max_m)
        points = (self._rays[:, ::STRIDE_PX, ::STRIDE_PX].reshape(3, -1)[:, known] * z[known]).T
        if len(points) < 50:
            return None
        limits = 0.02 + NOISE_PER_M2 * z[known] ** 2
        # The last floor usually fits; random planes are tried only if it does not.
        plane = self._previous(points, limits) or self._ransac(points, limits)
        if plane is None:
            return None
        for factor in (1.0, 0.7, 0.5):  # fewer and fewer points at the feet of walls
            near = np.abs(plane.heights_m(points)) < factor * limits
            plane = self._fit(points[near]) or plane
        return plane

    def _previous(self, points: F64, limits: F64) -> FloorPlane | None:
        """Return the last floor if enough points still lie on it."""
        if self.floor is None:
            return None
        heights = self.floor.heights_m(points)
        on, below = np.abs(heights) < limits, heights < -2 * limits
        fits = on.mean() >= SHARE_MIN and below.mean() < BELOW_MAX
        return self.floor if fits else None

    def _ransac(self, points: F64, limits: F64) -> FloorPlane | None:
        """Return the plane through three random points with the most points on it."""
        lower = points[points[:, 1] > 0]  # below the optical axis
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
        level = -normals[:, 1] > np.cos(np.radians(TILT_MAX_DEG))
        ok = level & (sizes > 1e-6) & (below < BELOW_MAX)
        best = int(np.argmax(np.where(ok, on, -1.0)))
        if not ok[best] or on[best] < SHARE_MIN:
            return None
        return FloorPlane(normals[best], float(-a[best] @ normals[best]))

    def _fit(self, points: F64) -> FloorPlane | None:
        if len(points) < 10:
            return None
        middle = points.mean(axis=0)
        up = np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 0]
        up = -up if up[1] > 0 else up
        if -up[1] < np.cos(np.radians(TILT_MAX_DEG)):
            return None
        return FloorPlane(up, float(-middle @ up))


@compiled
def _cut(depth_mm: U16, rays: F32, plane: F32, limits: F32) -> None:
    """Set pixels on a plane or below it to 0; the limit grows with the noise of the depth."""
    height, width = depth_mm.shape
    for row in range(height):
        for column in range(width):  # no branches, so it is vectorised
            away = np.float32(0.001) * np.float32(depth_mm[row, column])
            rise = plane[0] * rays[0, row, column] + plane[1] * rays[1, row, column]
            rise += plane[2] * rays[2, row, column]
            limit = limits[0] + limits[1] * away * away * abs(rise)
            on = away * rise + plane[3] < limit
            depth_mm[row, column] = np.uint16(0) if on else depth_mm[row, column]
