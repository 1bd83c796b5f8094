"""Reprojection of points of known or unknown depth after a motion of the base.

The covariance of a reprojection error is S = sigma^2 I + sigma_rho^2 j j', rho the inverse depth
and j the derivative by it: an error along the epipolar line of an unknown depth does not count
(docs/method.md section 18 [Civera 2008]).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import invert, rotation_from_rpy, transform_from
from people4d.messages import F64
from services.visual_odometry.twist import cross_matrices

Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]

ALL = np.arange(6)  # entries of a twist
PLANAR = np.array([0, 1, 5])  # entries of a twist on a floor
BEHIND = 1e-3  # minimum ratio of the depth to the depth in the keyframe


@dataclass(frozen=True)
class BaseMount:
    """Mounting of a camera on a base, and the freedom of the base."""

    base_from_optical: F64  # 4x4
    planar: bool  # the base stays on a floor, the plane of its x and y axes

    @property
    def free(self) -> Indices:
        """Free entries of a twist of the base."""
        return PLANAR if self.planar else ALL

    def level_motion(self, matrix: F64) -> F64:
        """Return the nearest possible motion of the base."""
        if not self.planar:
            return matrix
        rotation = rotation_from_rpy(0.0, 0.0, float(np.arctan2(matrix[1, 0], matrix[0, 0])))
        return transform_from((*matrix[:2, 3], 0.0), rotation)


@dataclass(frozen=True)
class Matches:
    """N points in a keyframe and in a frame, as rays x / z and y / z, frame: optical."""

    then: F64  # Nx2
    now: F64  # Nx2
    inverse_depths: F64  # [1/m] N, 1 / z then
    sigmas: F64  # [1/m] N, standard deviations of the inverse depths
    noise: F64  # N, standard deviations of each coordinate of a ray
    people: Flags  # N, points that may be on people: they count only if they move like the room


@dataclass(frozen=True)
class Reprojection:
    """Reprojection errors of M points after H motions, with derivatives."""

    off: F64  # HxMx2
    by_depth: F64  # HxMx2, derivative of the error by inverse depth
    here: F64  # HxMx3, position times inverse depth, frame: the base now
    lens: F64  # HxMx2x3, derivative of the ray by the point
    front: Flags  # HxM, points in front of the camera


class Reprojector:
    """Reprojects the points of matches."""

    def __init__(self, matches: Matches, mount: BaseMount) -> None:
        self.matches, self._mount = matches, mount
        base = mount.base_from_optical
        rays = np.column_stack([matches.then, np.ones(len(matches.then))])
        self._points = rays @ base[:3, :3].T + matches.inverse_depths[:, None] * base[:3, 3]
        self._optical_from_base = invert(base)

    def project_points(self, poses: F64, chosen: Indices) -> Reprojection:
        """Reproject the chosen points (HxM indices) after motions (Hx4x4)."""
        optical_from_base, matches = self._optical_from_base, self.matches
        turn, inverse = optical_from_base[:3, :3], matches.inverse_depths[chosen][..., None]
        here = (self._points[chosen] - inverse * poses[:, None, :3, 3]) @ poses[:, :3, :3]
        optical = here @ turn.T + inverse * optical_from_base[:3, 3]
        x, y, z = np.moveaxis(optical, -1, 0)
        front = z > BEHIND
        z = np.where(front, z, 1.0)
        off = np.stack([x / z, y / z], axis=-1) - matches.now[chosen]
        lens = np.zeros((*z.shape, 2, 3))
        lens[..., 0, 0] = lens[..., 1, 1] = 1 / z
        lens[..., 0, 2], lens[..., 1, 2] = -x / z**2, -y / z**2
        # With growing inverse depth a point moves by the motion of the camera.
        moved = -np.einsum("hji,hj->hi", poses[:, :3, :3], poses[:, :3, 3])
        lever = self._mount.base_from_optical[:3, 3]
        moved = (moved + np.einsum("hji,j->hi", poses[:, :3, :3], lever)) @ turn.T
        moved = moved + optical_from_base[:3, 3]
        by_depth = np.einsum("hmij,hj->hmi", lens, moved)
        return Reprojection(off, by_depth, here, lens, front)

    def by_twist(self, rays: Reprojection, chosen: Indices) -> F64:
        """Return the derivative of errors by the free entries of a twist (HxMx2xK)."""
        motions = np.zeros((*chosen.shape, 3, 6))
        motions[..., :3] = -self.matches.inverse_depths[chosen][..., None, None] * np.eye(3)
        motions[..., 3:] = cross_matrices(rays.here)
        optical = self._optical_from_base[:3, :3] @ motions[..., self._mount.free]
        return np.asarray(rays.lens @ optical)

    def along(self, rays: Reprojection, chosen: Indices) -> F64:
        """Return a (HxM) of S^-1 = (I - a j j') / sigma^2."""
        variance = self.matches.sigmas[chosen] ** 2
        length = np.einsum("hmi,hmi->hm", rays.by_depth, rays.by_depth)
        return np.asarray(variance / (self.matches.noise[chosen] ** 2 + variance * length))

    def cost(self, rays: Reprojection, chosen: Indices) -> F64:
        """Return e' S^-1 e (HxM), the squared number of standard deviations."""
        across = np.einsum("hmi,hmi->hm", rays.off, rays.off)
        along = np.einsum("hmi,hmi->hm", rays.by_depth, rays.off) ** 2
        cost = (across - self.along(rays, chosen) * along) / self.matches.noise[chosen] ** 2
        return np.where(rays.front, np.maximum(cost, 0.0), np.inf)
