"""Keyframes: images with landmarks, with which later frames are compared."""

from dataclasses import dataclass, fields, replace

import numpy as np

from common.geometry.transforms import apply, invert, project
from people4d.messages import F32, F64, U8
from services.visual_odometry.corners import (
    CELL_PX,
    OdometryFrame,
    PeopleRegions,
    ReducedCamera,
    find_corners,
    read_depth_m,
)
from services.visual_odometry.fit import MotionFit, MotionPrior
from services.visual_odometry.reprojection import PLANAR, BaseMount, Flags, Indices, Matches

NEAR_MAX = 150  # maximum number of landmarks in the room with depth
FAR_MAX = 100  # maximum number of landmarks beyond the range of the sensor
PEOPLE_MAX = 50  # maximum number of landmarks on people
SIGMA_INVERSE = 0.004  # sigma of inverse depth [1/m]: 0.1 px between two imagers 5 cm apart
UNKNOWN_M = 0.5  # maximum standard deviation of a known depth [m]
INVERSE_MIN = 0.005  # minimum inverse depth [1/m]
IMPROVED = 0.6  # maximum ratio of a propagated depth's standard deviation to the first one
DRIFT_FACTOR = 2.5  # inflation of the motion's standard deviation: keyframes are correlated
# Inverse depth and standard deviation beyond the range, relative to the minimum inverse depth
FAR, FAR_SIGMA = 0.6, 0.3


@dataclass(frozen=True)
class PoseEstimate:
    """Pose of the base."""

    matrix: F64  # 4x4, fixed_from_base
    covariance: F64  # 3x3 of x, y and yaw in the fixed frame


@dataclass(frozen=True)
class Landmarks:
    """Corners of an image, each a ray with an uncertain inverse depth."""

    pixels: F32  # [px] Nx2, in the reduced image
    rays: F64  # Nx2, x / z and y / z, frame: optical
    inverse_depths: F64  # [1/m] N, current estimates of 1 / z
    sigmas: F64  # [1/m] N, standard deviations of the estimates
    first: F64  # [1/m] Nx2, first estimates and their standard deviations
    people: Flags  # N, landmarks that may be on people

    @property
    def positions_m(self) -> F64:
        """Most likely positions (Nx3), frame: optical."""
        return np.column_stack([self.rays, np.ones(len(self.rays))]) / self.inverse_depths[:, None]

    @property
    def depths_m(self) -> F64:
        """Depths (N); NaN if unknown."""
        depths = 1 / self.inverse_depths
        return np.where(self.sigmas * depths**2 < UNKNOWN_M, depths, np.nan)

    def select_landmarks(self, which: Flags | Indices) -> "Landmarks":
        """Return a selection of the landmarks."""
        return Landmarks(*(getattr(self, field.name)[which] for field in fields(self)))

    def match_rays(self, found: Flags, rays: F64, noise: tuple[float, float]) -> Matches:
        """Return the matches of the found landmarks (N flags) and their rays in a frame.

        `noise`: standard deviations of a ray to the room, and of a ray to a person.
        """
        some = self.select_landmarks(found)
        noises = np.where(some.people, noise[1], noise[0])
        return Matches(some.rays, rays, some.inverse_depths, some.sigmas, noises, some.people)

    def refine_depths(self, found: Flags, fit: MotionFit) -> "Landmarks":
        """Return the landmarks with the depths that the motion improves.

        A depth combines the first estimate with the most informative motion only, since the errors
        of motions from one keyframe are correlated.
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
    """An image with its landmarks and the pose of the base."""

    stamp_ns: int
    grey: U8
    points: Landmarks
    pose: PoseEstimate

    def mark_people(self, people: PeopleRegions, camera: ReducedCamera) -> "Keyframe":
        """Return the keyframe with landmarks on people marked."""
        points = self.points
        covered = people.cover_points(camera.to_full(points.pixels), points.depths_m)
        return replace(self, points=replace(points, people=points.people | covered))

    def project_landmarks(
        self, fixed_from_base: F64, mount: BaseMount, camera: ReducedCamera
    ) -> tuple[F32, float]:
        """Return the predicted pixels of the landmarks (Nx2), and the share inside the image."""
        positions = apply(self._now_from_then(fixed_from_base, mount), self.points.positions_m)
        before = positions[:, 2] > 0.1
        pixels = self.points.pixels.copy()
        pixels[before] = camera.to_reduced(project(positions[before], camera.info))
        size = self.grey.shape[::-1]
        inside = before & np.all((pixels >= 0) & (pixels < size), axis=1)
        return pixels, float(inside.mean()) if len(inside) else 0.0

    def propagate_landmarks(
        self, comparison: "Comparison", mount: BaseMount, camera: ReducedCamera
    ) -> Landmarks:
        """Return the landmarks beyond the sensor's range with the depths known from motion."""
        rows = np.flatnonzero(comparison.found)[comparison.fit.inliers]
        old, pixels = self.points.select_landmarks(rows), comparison.pixels[rows]
        now_from_then = self._now_from_then(comparison.pose.matrix, mount)
        positions = apply(now_from_then, old.positions_m)
        improved = (old.sigmas > SIGMA_INVERSE) & (old.sigmas < IMPROVED * old.first[:, 1])
        improved &= positions[:, 2] > 0.1
        inverse = 1 / np.where(improved, positions[:, 2], 1.0)
        sigmas = old.sigmas * (inverse / old.inverse_depths) ** 2
        first = np.column_stack([inverse, sigmas])
        now = Landmarks(pixels, camera.rays(pixels), inverse, sigmas, first, old.people)
        return now.select_landmarks(improved & ~old.people)

    def _now_from_then(self, fixed_from_base: F64, mount: BaseMount) -> F64:
        then = self.pose.matrix @ mount.base_from_optical
        return invert(fixed_from_base @ mount.base_from_optical) @ then


@dataclass(frozen=True)
class Attempt:
    """A keyframe to compare with a frame."""

    keyframe: Keyframe
    guess_px: F32  # Nx2, predicted pixels of the landmarks
    prior: MotionPrior  # prediction of the motion since the keyframe


@dataclass(frozen=True)
class Comparison:
    """Result of the comparison of a frame with a keyframe."""

    keyframe: Keyframe
    pixels: F32  # Nx2, tracked pixels of the landmarks
    found: Flags  # N, landmarks with valid optical flow
    fit: MotionFit
    overlap: float  # share of the landmarks that agree with the motion

    @property
    def pose(self) -> PoseEstimate:
        """Pose of the base: pose of the keyframe, then the motion."""
        then = self.keyframe.pose
        matrix = then.matrix @ self.fit.before_from_now
        lever = np.eye(3)
        away_m = matrix[:2, 3] - then.matrix[:2, 3]
        lever[:2, 2] = -away_m[1], away_m[0]  # displacement by an error of the keyframe's yaw
        own = on_floor(self.fit.covariance + self.fit.common)
        own = DRIFT_FACTOR**2 * rotated_covariance(own, matrix)
        return PoseEstimate(matrix, lever @ then.covariance @ lever.T + own)


def rotated_covariance(covariance: F64, fixed_from_base: F64) -> F64:
    """Rotate a covariance (3x3) of x, y and yaw from the base to the fixed frame."""
    rotation = np.eye(3)
    rotation[:2, :2] = fixed_from_base[:2, :2]
    return np.asarray(rotation @ covariance @ rotation.T)


def on_floor(covariance: F64) -> F64:
    """Return the entries (3x3) of x, y and yaw of a covariance of a twist (KxK)."""
    return covariance[np.ix_(PLANAR, PLANAR)] if len(covariance) > len(PLANAR) else covariance


def detect_landmarks(
    frame: OdometryFrame, grey: U8, camera: ReducedCamera
) -> tuple[Landmarks, int, int]:
    """Detect the landmarks of a frame and of its reduced image `grey`.

    Landmarks are corners with a depth reading or beyond the range of the sensor. Also returned are
    the number of corners in the room with a depth reading, and the number of all corners.
    """
    corners = find_corners(grey)
    pixels = camera.to_full(corners)
    depths_m, far = read_depth_m(frame.depth_mm, pixels)
    near = np.isfinite(depths_m)
    people = frame.people.cover_points(pixels, depths_m)
    groups = ((near & ~people, NEAR_MAX), (far & ~people, FAR_MAX), (near & people, PEOPLE_MAX))
    good = np.concatenate([np.flatnonzero(which)[:most] for which, most in groups])
    near, people = near[good], people[good]
    # Beyond the range of the sensor any depth is possible.
    beyond = 1 / camera.info.max_depth_m
    inverse = 1 / np.where(near, depths_m[good], 1 / (FAR * beyond))
    sigmas = np.where(near, SIGMA_INVERSE, FAR_SIGMA * beyond)
    first = np.column_stack([inverse, sigmas])
    points = Landmarks(corners[good], camera.rays(corners[good]), inverse, sigmas, first, people)
    return points, int((near & ~people).sum()), len(corners)


def merge_landmarks(old: Landmarks, new: Landmarks) -> Landmarks:
    """Return the old landmarks and the new landmarks in other cells."""
    taken = {tuple(cell) for cell in (old.pixels // CELL_PX).astype(int).tolist()}
    cells = (new.pixels // CELL_PX).astype(int).tolist()
    free = np.array([tuple(cell) not in taken for cell in cells], np.bool_)
    some = new.select_landmarks(free)
    columns = [(getattr(old, field.name), getattr(some, field.name)) for field in fields(old)]
    return Landmarks(*map(np.concatenate, columns))
