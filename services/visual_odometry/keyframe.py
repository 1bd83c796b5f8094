"""Keyframes: images with landmarks that later frames are compared with."""

from dataclasses import dataclass, fields, replace

import numpy as np

from common.geometry.transforms import apply, invert, project
from people4d.messages import F32, F64, U8
from services.visual_odometry.config import CornerConfig
from services.visual_odometry.corners import (
    OdometryFrame,
    PeopleRegions,
    ReducedCamera,
    find_corners,
    read_depth_m,
)
from services.visual_odometry.fit import MotionFit, MotionPrior
from services.visual_odometry.reprojection import PLANAR, BaseMount, Flags, Indices, Matches

UNKNOWN_M = 0.5  # standard deviation of a depth from which on it counts as unknown
INVERSE_MIN = 0.005  # [1/m] inverse depth
IMPROVED = 0.6  # of the first standard deviation: a depth estimated better is propagated
# On the standard deviation of a motion as it adds up: errors of keyframes are correlated
DRIFT_FACTOR = 2.5
FAR, FAR_SIGMA = 0.6, 0.3  # of the least inverse depth that is read: all between it and none


@dataclass(frozen=True)
class PoseEstimate:
    """Pose of the base."""

    matrix: F64  # 4x4, fixed_from_base
    covariance: F64  # 3x3 of x, y and yaw in the fixed frame


@dataclass(frozen=True)
class Landmarks:
    """Corners of an image, along their rays at an uncertain inverse depth."""

    pixels: F32  # [px] Nx2, in the reduced image
    rays: F64  # Nx2, x / z and y / z, frame: optical
    inverse_depths: F64  # [1/m] N, 1 / z as estimated now
    sigmas: F64  # [1/m] N, standard deviations of these
    first: F64  # [1/m] Nx2, inverse depths and their standard deviations at first
    people: Flags  # N, those that may be on people

    @property
    def positions_m(self) -> F64:
        """Likeliest positions (Nx3), frame: optical."""
        return np.column_stack([self.rays, np.ones(len(self.rays))]) / self.inverse_depths[:, None]

    @property
    def depths_m(self) -> F64:
        """Depths (N); NaN if unknown."""
        depths = 1 / self.inverse_depths
        return np.where(self.sigmas * depths**2 < UNKNOWN_M, depths, np.nan)

    def chosen(self, which: Flags | Indices) -> "Landmarks":
        """Return some of them."""
        return Landmarks(*(getattr(self, field.name)[which] for field in fields(self)))

    def matches(self, found: Flags, rays: F64, noise: tuple[float, float]) -> Matches:
        """Return the found ones (N flags) with their rays in another frame.

        `noise` are the standard deviations of a ray to the room, and of one to a person.
        """
        some = self.chosen(found)
        noises = np.where(some.people, noise[1], noise[0])
        return Matches(some.rays, rays, some.inverse_depths, some.sigmas, noises, some.people)

    def refined(self, found: Flags, fit: MotionFit) -> "Landmarks":
        """Return them with the depths that a motion gives better than before.

        Each combines the first estimate and that of one motion only, the most informative one:
        errors of many motions from one keyframe are correlated.
        """
        rows = np.flatnonzero(found)[fit.inliers]
        # Errors of the fit are relative to the current estimate, not to the first.
        measured = self.inverse_depths[rows] + fit.depth_errors[fit.inliers]
        variance = fit.depth_sigmas[fit.inliers] ** 2
        first, first_variance = self.first[rows, 0], self.first[rows, 1] ** 2
        both = 1 / (1 / variance + 1 / first_variance)
        better = np.sqrt(both) < self.sigmas[rows]
        inverse = both * (measured / variance + first / first_variance)
        depths, sigmas = self.inverse_depths.copy(), self.sigmas.copy()
        depths[rows[better]] = np.maximum(inverse[better], INVERSE_MIN)
        sigmas[rows[better]] = np.sqrt(both[better])
        return replace(self, inverse_depths=depths, sigmas=sigmas)


@dataclass(frozen=True)
class Keyframe:
    """An image with its landmarks, and the pose of the base then."""

    stamp_ns: int
    grey: U8
    points: Landmarks
    pose: PoseEstimate

    def with_people(
        self, people: PeopleRegions, camera: ReducedCamera, config: CornerConfig
    ) -> "Keyframe":
        """Return the keyframe with the landmarks marked that may be on people."""
        points = self.points
        covered = people.cover(camera.to_full(points.pixels), points.depths_m, config)
        return replace(self, points=replace(points, people=points.people | covered))

    def project(
        self, fixed_from_base: F64, mount: BaseMount, camera: ReducedCamera
    ) -> tuple[F32, float]:
        """Return the pixels of its landmarks (Nx2), and the share of them inside the image."""
        positions = apply(self._now_from_then(fixed_from_base, mount), self.points.positions_m)
        before = positions[:, 2] > 0.1
        pixels = self.points.pixels.copy()
        pixels[before] = camera.to_reduced(project(positions[before], camera.info))
        size = self.grey.shape[::-1]
        inside = before & np.all((pixels >= 0) & (pixels < size), axis=1)
        return pixels, float(inside.mean()) if len(inside) else 0.0

    def propagate(
        self,
        comparison: "Comparison",
        mount: BaseMount,
        camera: ReducedCamera,
        config: CornerConfig,
    ) -> Landmarks:
        """Return its landmarks beyond the range of the sensor, as found again in a frame."""
        rows = np.flatnonzero(comparison.found)[comparison.fit.inliers]
        old, pixels = self.points.chosen(rows), comparison.pixels[rows]
        now_from_then = self._now_from_then(comparison.pose.matrix, mount)
        positions = apply(now_from_then, old.positions_m)
        improved = (old.sigmas > config.sigma_inverse) & (old.sigmas < IMPROVED * old.first[:, 1])
        improved &= positions[:, 2] > 0.1
        inverse = 1 / np.where(improved, positions[:, 2], 1.0)
        sigmas = old.sigmas * (inverse / old.inverse_depths) ** 2
        first = np.column_stack([inverse, sigmas])
        now = Landmarks(pixels, camera.rays(pixels), inverse, sigmas, first, old.people)
        return now.chosen(improved & ~old.people)

    def _now_from_then(self, fixed_from_base: F64, mount: BaseMount) -> F64:
        then = self.pose.matrix @ mount.base_from_optical
        return invert(fixed_from_base @ mount.base_from_optical) @ then


@dataclass(frozen=True)
class Attempt:
    """A keyframe to compare a frame with."""

    keyframe: Keyframe
    guess_px: F32  # Nx2, predicted pixels of its landmarks
    prior: MotionPrior  # of the motion since


@dataclass(frozen=True)
class Comparison:
    """A keyframe that a frame was compared with, and the motion since."""

    keyframe: Keyframe
    pixels: F32  # Nx2, of its landmarks
    found: Flags  # N, landmarks that were found again
    fit: MotionFit
    overlap: float  # share of its landmarks that were found again and agree

    @property
    def pose(self) -> PoseEstimate:
        """Pose of the base: that of the keyframe, and the motion since."""
        then = self.keyframe.pose
        matrix = then.matrix @ self.fit.before_from_now
        lever = np.eye(3)
        away_m = matrix[:2, 3] - then.matrix[:2, 3]
        lever[:2, 2] = -away_m[1], away_m[0]  # effect of an error of the keyframe's yaw
        own = on_floor(self.fit.covariance + self.fit.common)
        own = DRIFT_FACTOR**2 * rotated_covariance(own, matrix)
        return PoseEstimate(matrix, lever @ then.covariance @ lever.T + own)


def rotated_covariance(covariance: F64, fixed_from_base: F64) -> F64:
    """Return the covariance (3x3) of x, y and yaw in the fixed frame, from that in the base."""
    rotation = np.eye(3)
    rotation[:2, :2] = fixed_from_base[:2, :2]
    return np.asarray(rotation @ covariance @ rotation.T)


def on_floor(covariance: F64) -> F64:
    """Return the entries (3x3) of x, y and yaw of a covariance of a twist (KxK)."""
    return covariance[np.ix_(PLANAR, PLANAR)] if len(covariance) > len(PLANAR) else covariance


def detect_landmarks(
    frame: OdometryFrame, grey: U8, camera: ReducedCamera, config: CornerConfig
) -> tuple[Landmarks, int, int]:
    """Return the landmarks of a frame, whose reduced image is given.

    Landmarks are corners with a depth reading, or too far for the sensor. Beside them, the number
    of those of the room with a depth reading, and the number of all corners.
    """
    corners = find_corners(grey, config)
    pixels = camera.to_full(corners)
    depths_m, far = read_depth_m(frame.depth_mm, pixels, config)
    near = np.isfinite(depths_m)
    people = frame.people.cover(pixels, depths_m, config)
    groups = (
        (near & ~people, config.near_max),
        (far & ~people, config.far_max),
        (near & people, config.people_max),
    )
    good = np.concatenate([np.flatnonzero(which)[:most] for which, most in groups])
    near, people = near[good], people[good]
    # Points out of range of the sensor are anywhere beyond.
    beyond = 1 / camera.info.max_depth_m
    inverse = 1 / np.where(near, depths_m[good], 1 / (FAR * beyond))
    sigmas = np.where(near, config.sigma_inverse, FAR_SIGMA * beyond)
    first = np.column_stack([inverse, sigmas])
    points = Landmarks(corners[good], camera.rays(corners[good]), inverse, sigmas, first, people)
    return points, int((near & ~people).sum()), len(corners)


def merge(old: Landmarks, new: Landmarks, cell_px: int) -> Landmarks:
    """Return landmarks and new ones in other cells."""
    taken = {tuple(cell) for cell in (old.pixels // cell_px).astype(int).tolist()}
    cells = (new.pixels // cell_px).astype(int).tolist()
    free = np.array([tuple(cell) not in taken for cell in cells], np.bool_)
    some = new.chosen(free)
    columns = [(getattr(old, field.name), getattr(some, field.name)) for field in fields(old)]
    return Landmarks(*map(np.concatenate, columns))
