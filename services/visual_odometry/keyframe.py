"""A picture that later ones are compared with."""

from dataclasses import dataclass, fields, replace

import numpy as np

from common.geometry.transforms import apply, invert, project
from people4d.messages import F32, F64, U8
from services.visual_odometry.config import CornerConfig
from services.visual_odometry.fit import BOOL, INDICES, Fit, Mount, Sights
from services.visual_odometry.points import Lens, People, View, find_corners, read_depth_m

HARDLY_M = 0.5  # standard deviation of a depth from which on it is hardly known
LEAST = 0.005  # [1/m] inverse depth
LEARNT = 0.6  # of what was not known of a depth at first: less is worth handing on
FAR, FAR_SIGMA = 0.6, 0.3  # of the least inverse depth that is read: all between it and none


@dataclass(frozen=True)
class Place:
    """Where the base is.

    Args:
        matrix: 4x4, fixed_from_base.
        covariance: 3x3 of x, y and heading in the fixed frame.
    """

    matrix: F64
    covariance: F64


@dataclass(frozen=True)
class Points:
    """Corners of a picture, along their rays at an inverse depth that is known more or less.

    Args:
        pixels: Nx2, in the reduced picture.
        rays: Nx2, x / z and y / z, frame: optical.
        inverse_depths: N, 1 / z in 1/m, as known now.
        sigmas: N, standard deviations of these.
        first: Nx2, inverse depths and their standard deviations as known at first.
        people: N, which of them may be on people.
    """

    pixels: F32
    rays: F64
    inverse_depths: F64
    sigmas: F64
    first: F64
    people: BOOL

    @property
    def places_m(self) -> F64:
        """Where they are likeliest (Nx3), frame: optical."""
        return np.column_stack([self.rays, np.ones(len(self.rays))]) / self.inverse_depths[:, None]

    @property
    def depths_m(self) -> F64:
        """How far they are (N); NaN where that is hardly known."""
        depths = 1 / self.inverse_depths
        return np.where(self.sigmas * depths**2 < HARDLY_M, depths, np.nan)

    def chosen(self, which: BOOL | INDICES) -> "Points":
        """Return some of them."""
        return Points(*(getattr(self, field.name)[which] for field in fields(self)))

    def sights(self, there: BOOL, rays: F64, noise: tuple[float, float]) -> Sights:
        """Return some of them with the rays (Nx2) at which they are seen again.

        Args:
            there: N, which of them.
            rays: Of these.
            noise: Standard deviation of a ray to the room, and of one to a person.
        """
        some = self.chosen(there)
        noises = np.where(some.people, noise[1], noise[0])
        return Sights(some.rays, rays, some.inverse_depths, some.sigmas, noises, some.people)

    def refined(self, there: BOOL, fit: Fit) -> "Points":
        """Return them with the depths that a motion tells better than was known.

        Each is put together of what was known at first and of one motion only, the one that tells
        most: what many motions from one keyframe get wrong, they get wrong together.
        """
        rows = np.flatnonzero(there)[fit.inliers]
        # How each point was seen off its place is by its depth as known now: back to the first.
        told = self.inverse_depths[rows] + fit.depth_errors[fit.inliers]
        variance = fit.depth_sigmas[fit.inliers] ** 2
        first, first_variance = self.first[rows, 0], self.first[rows, 1] ** 2
        both = 1 / (1 / variance + 1 / first_variance)
        better = np.sqrt(both) < self.sigmas[rows]
        inverse = both * (told / variance + first / first_variance)
        depths, sigmas = self.inverse_depths.copy(), self.sigmas.copy()
        depths[rows[better]] = np.maximum(inverse[better], LEAST)
        sigmas[rows[better]] = np.sqrt(both[better])
        return replace(self, inverse_depths=depths, sigmas=sigmas)


@dataclass(frozen=True)
class Keyframe:
    """A picture with its points, and where the base was then."""

    stamp_ns: int
    grey: U8
    points: Points
    place: Place

    def with_people(self, people: People, lens: Lens, config: CornerConfig) -> "Keyframe":
        """Return the keyframe with the points marked that may be people's."""
        points = self.points
        covered = people.cover(lens.whole(points.pixels), points.depths_m, config)
        return replace(self, points=replace(points, people=points.people | covered))

    def seen_from(self, fixed_from_base: F64, mount: Mount, lens: Lens) -> tuple[F32, float]:
        """Return where its points would be seen (Nx2), and the share of them inside the picture.

        Args:
            fixed_from_base: 4x4, where the base may be.
            mount: Of the camera.
            lens: Of the camera.
        """
        seen = apply(self._now_from_then(fixed_from_base, mount), self.points.places_m)
        before = seen[:, 2] > 0.1
        pixels = self.points.pixels.copy()
        pixels[before] = lens.reduced(project(seen[before], lens.info))
        size = self.grey.shape[::-1]
        inside = before & np.all((pixels >= 0) & (pixels < size), axis=1)
        return pixels, float(inside.mean()) if len(inside) else 0.0

    def handed_on(
        self, fixed_from_base: F64, seen: "Again", mount: Mount, config: CornerConfig
    ) -> Points:
        """Return its points that the sensor is too far from, as they are seen from another place.

        Args:
            fixed_from_base: 4x4, where the base is.
            seen: The points that were found again there.
            mount: Of the camera.
            config: What is known of depth.
        """
        old = self.points.chosen(seen.rows)
        places = apply(self._now_from_then(fixed_from_base, mount), old.places_m)
        learnt = (old.sigmas > config.sigma_inverse) & (old.sigmas < LEARNT * old.first[:, 1])
        learnt &= places[:, 2] > 0.1
        inverse = 1 / np.where(learnt, places[:, 2], 1.0)
        sigmas = old.sigmas * (inverse / old.inverse_depths) ** 2
        first = np.column_stack([inverse, sigmas])
        now = Points(seen.pixels, seen.rays, inverse, sigmas, first, old.people)
        return now.chosen(learnt & ~old.people)

    def _now_from_then(self, fixed_from_base: F64, mount: Mount) -> F64:
        then = self.place.matrix @ mount.base_from_optical
        return invert(fixed_from_base @ mount.base_from_optical) @ then


@dataclass(frozen=True)
class Again:
    """Points of a keyframe that were found in a later frame: N rows, pixels and rays there."""

    rows: INDICES
    pixels: F32
    rays: F64


@dataclass(frozen=True)
class Corners:
    """What there is to see in a frame.

    Args:
        points: Corners whose depth is known, or too far for the sensor.
        near: Number of those of the room whose depth is known.
        count: Number of all corners.
    """

    points: Points
    near: int
    count: int


def look_for_corners(view: View, grey: U8, lens: Lens, config: CornerConfig) -> Corners:
    """Return what there is to see in a frame.

    Args:
        view: The frame.
        grey: Its reduced picture.
        lens: Of the camera.
        config: Which points are good.
    """
    corners = find_corners(grey, config)
    whole = lens.whole(corners)
    depths_m, far = read_depth_m(view.depth_mm, whole, config)
    near = np.isfinite(depths_m)
    people = view.people.cover(whole, depths_m, config)
    some = (
        np.flatnonzero(near & ~people)[: config.near_max],
        np.flatnonzero(far & ~people)[: config.far_max],
        np.flatnonzero(near & people)[: config.people_max],
    )
    good = np.concatenate(some)
    near, people = near[good], people[good]
    # What the sensor does not reach is anywhere beyond.
    beyond = 1 / lens.info.max_depth_m
    inverse = 1 / np.where(near, depths_m[good], 1 / (FAR * beyond))
    sigmas = np.where(near, config.sigma_inverse, FAR_SIGMA * beyond)
    first = np.column_stack([inverse, sigmas])
    points = Points(corners[good], lens.rays(corners[good]), inverse, sigmas, first, people)
    return Corners(points, int((near & ~people).sum()), len(corners))


def together(kept: Points, new: Points, cell_px: int) -> Points:
    """Return points and new ones that are not beside them."""
    taken = {tuple(cell) for cell in (kept.pixels // cell_px).astype(int).tolist()}
    cells = (new.pixels // cell_px).astype(int).tolist()
    free = np.array([tuple(cell) not in taken for cell in cells], np.bool_)
    some = new.chosen(free)
    return Points(
        *(
            np.concatenate([getattr(kept, field.name), getattr(some, field.name)])
            for field in fields(kept)
        )
    )
