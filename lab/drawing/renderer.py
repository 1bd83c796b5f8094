"""Images of the virtual lab: depth with the owner of each pixel, and colour."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from common.geometry.transforms import camera_matrix, invert
from lab.depth.config import DepthSensorModel
from lab.depth.infrared import returned
from lab.drawing.ambient import COARSE, bounce_light, corner_light, direct_light
from lab.drawing.colour import develop, grain
from lab.drawing.mesh import Mesh, join
from lab.drawing.mirrors import REFLECTANCE, mirror_views, rasterise_image
from lab.drawing.raster import Raster, at_once, homogeneous, in_bands, rasterise
from lab.drawing.rooms import Room
from lab.drawing.shading import SampleArrays, SceneArrays, SceneLighting, shade_rows
from lab.drawing.shadows import pixels_from_map, room_shadow_maps, shadow_map
from people4d.messages import F32, F64, U8, CameraInfo

WHITE = 0.9  # reflectance of a sheet that appears white with an exposure of 1


@dataclass(frozen=True)
class DepthView:
    """Geometry visible to the camera, without errors."""

    depth_m: F32  # HxW along the optical axis, inf: no surface
    owners: U8  # HxW, 0: room or nothing, k + 1: person k
    right_depth_m: F32  # HxW in the view of the right imager of the stereo pair


@dataclass(frozen=True)
class SurfaceView:
    """Depth and light visible to a depth sensor with a projector, without errors."""

    depth_m: F32  # HxW along the optical axis, inf: no surface
    right_depth_m: F32  # HxW in the view of the projector
    light: F32  # HxW, see `infrared.returned`


@dataclass(frozen=True)
class Extent:
    """Area of an unoccluded body in the image."""

    pixels: int  # number of pixels inside the image
    box_xyxy_px: F64  # 4, bounding box, right and lower edge exclusive; NaN if empty


def draw_depth(
    meshes: Sequence[Mesh],
    optical_from_map: F64,
    info: CameraInfo,
    baseline_m: float,
    threads: int = 1,
) -> DepthView:
    """Draw depth and owners of meshes, including the room, for an error-free pair of imagers.

    Lens distortion is not drawn. The right imager is at the baseline to the right of the left.
    """
    size = (info.height, info.width)
    if not meshes:
        empty: F32 = np.full(size, np.inf, np.float32)
        return DepthView(empty, np.zeros(size, np.uint8), empty.copy())
    scene = join(meshes)
    left, right = _stereo(scene, optical_from_map, info, baseline_m, threads)
    owners = np.append(scene.owner, 0).astype(np.uint8)[left.triangle]
    return DepthView(left.depth_m(), owners, right.depth_m())


def draw_surfaces(
    meshes: Sequence[Mesh],
    optical_from_map: F64,
    info: CameraInfo,
    config: DepthSensorModel,
    threads: int = 1,
) -> SurfaceView:
    """Draw at least one mesh for a depth imager next to the colour camera of the given pose."""
    scene = join(meshes)
    beside = optical_from_map.copy()
    beside[0, 3] -= config.colour_offset_m
    left, right = _stereo(scene, beside, info, config.baseline_m, threads)
    depth_m = left.depth_m()
    light = returned(scene, left.triangle, beside, pixel_rays(info), depth_m)
    return SurfaceView(depth_m, right.depth_m(), light)


def _stereo(
    scene: Mesh, optical_from_map: F64, info: CameraInfo, baseline_m: float, threads: int
) -> tuple[Raster, Raster]:
    """Rasterise a scene for the left and the right imager."""
    # One thread per view is faster than two threads per view in turn: triangles are set up once.
    left, right = at_once(
        [
            partial(rasterise_image, scene, optical_from_map, info, shift_px, max(threads // 2, 1))
            for shift_px in (0.0, info.fx * baseline_m)
        ],
        threads,
    )
    return left, right


def pixel_rays(info: CameraInfo) -> F64:
    """Return HxWx3 directions of the pixels in the optical frame, z = 1."""
    u, v = np.meshgrid(np.arange(info.width), np.arange(info.height))
    x, y = (u - info.cx) / info.fx, (v - info.cy) / info.fy
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def body_extents(mesh: Mesh, optical_from_map: F64, info: CameraInfo) -> Extent:
    """Return the area of an unoccluded body in the image."""
    corners = homogeneous(mesh.vertices_m, camera_matrix(info) @ optical_from_map[:3])
    raster = rasterise(corners, mesh.faces, (info.height, info.width)).triangle >= 0
    rows, columns = np.flatnonzero(raster.any(axis=1)), np.flatnonzero(raster.any(axis=0))
    if not len(rows):
        return Extent(0, np.full(4, np.nan))
    box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.float64)
    return Extent(int(raster.sum()), box)


@dataclass(frozen=True)
class Instant:
    """The scene at one instant."""

    people: Sequence[Mesh]  # people and objects; the room belongs to the renderer
    optical_from_map: F64  # transform into the camera, 4x4


@dataclass(frozen=True)
class Development:
    """Settings of the camera that change from frame to frame."""

    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)  # gains of red, green and blue
    grain: float = 1.0  # noise relative to a sensor in good light
    blur_px: float = 0.0  # standard deviation of defocus


PLAIN = Development()


@dataclass(frozen=True)
class Shaded:
    """Radiance of one instant."""

    image: F32  # HxWx3, linear
    people: npt.NDArray[np.bool_]  # HxW, True: people cover the pixel
    light: SceneLighting  # lights of the instant


class Renderer:
    """Draws people in a room in colour.

    The state is constant: the room, its shadows and the light of its walls. Frames may therefore be
    drawn in any order, with the same bytes.
    """

    def __init__(
        self, room: Room, info: CameraInfo, seed: int, threads: int = 1, samples: int = 2
    ) -> None:
        """Prepare a room.

        Args:
            room: See `rooms.room_mesh`.
            info: Calibration; lens distortion is not drawn.
            seed: Seed of the sensor's noise.
            threads: Number of threads; the image does not depend on it.
            samples: Samples along each side of a pixel, 1 (aliased) or 2.
        """
        self.room, self.info, self.seed = room, info, seed
        self.threads, self.samples = threads, samples
        self._projections = np.stack([pixels_from_map(light) for light in room.lights])
        self._maps = room_shadow_maps(room)
        self._bounce = bounce_light(room)
        self._lights = np.array(
            [[*x.position_m, *x.towards, *x.intensity, x.radius_m] for x in room.lights]
        )
        self._grain = grain(seed)
        self._exposure = room.exposure / self._white()

    def exposed(self, instants: Sequence[Instant], frame: int, settings: Development = PLAIN) -> U8:
        """Return the image of an exposure over several instants, with motion blur.

        For a static camera the room is shaded once, and only people are drawn at each instant.
        """
        middle = instants[len(instants) // 2]
        first = self._draw(middle)
        stands = all(np.array_equal(i.optical_from_map, middle.optical_from_map) for i in instants)
        base = first if stands else None
        radiance = np.zeros_like(first.image)
        for instant in instants:
            radiance += (first if instant is middle else self._draw(instant, base)).image
        radiance /= np.float32(len(instants))
        radiance *= np.array(settings.gains, np.float32)
        if settings.blur_px:
            radiance = gaussian_filter(radiance, (settings.blur_px, settings.blur_px, 0))
        key, noise = (self.seed, frame), self._grain * np.float32(settings.grain)
        return develop(radiance, self._exposure, noise, key, self.threads)

    def radiance(self, instant: Instant) -> F32:
        """Return the radiance of each pixel, HxWx3, linear."""
        return self._draw(instant).image

    def _draw(
        self, instant: Instant, base: Shaded | None = None, limit: F32 | None = None
    ) -> Shaded:
        """Return the radiance of each pixel.

        Args:
            instant: Scene at one instant.
            base: Another instant in the same view, whose room and light are used; or None.
            limit: Part of the image in a mirror, see `mirror_views`; None: the scene itself.
        """
        mesh = join([*instant.people, self.room.mesh])
        corners = homogeneous(mesh.vertices_m, self._samples_from_map(instant.optical_from_map))
        size = (self.info.height * self.samples, self.info.width * self.samples)
        raster = rasterise(corners, mesh.faces, size, self.threads, limit)
        image = np.empty((self.info.height, self.info.width, 3), np.float32)
        eye = invert(instant.optical_from_map)[:3, 3]
        scene = SceneArrays(
            corners,
            mesh.vertices_m,
            mesh.normals,
            mesh.texture_m,
            mesh.colour,
            mesh.faces,
            mesh.material,
            mesh.pattern,
            np.ascontiguousarray(eye),
        )
        samples = SampleArrays(
            raster.inverse_depth,
            raster.triangle,
            self.samples,
            self.info.fx * self.samples,
            self.samples * COARSE,
        )
        light = base.light if base else self._lighting(instant.people, raster)
        faces = sum(len(one.faces) for one in instant.people)
        drawn = self._pixels((raster.triangle >= 0) & (raster.triangle < faces))
        people = np.asarray(drawn.any(axis=(1, 3)))
        wanted = people | base.people if base else np.ones_like(people)
        if base:
            image[:] = base.image
        in_bands(
            lambda first, last: shade_rows(scene, light, samples, wanted, first, last, image),
            self.info.height,
            self.threads,
        )
        for reflection, inside in mirror_views(mesh, raster) if limit is None else ():
            reflected = Instant(instant.people, instant.optical_from_map @ reflection)
            share = self._pixels(inside > 0).mean(axis=(1, 3))[..., None]
            image += share * (REFLECTANCE * self._draw(reflected, limit=inside).image - image)
        return Shaded(image, people, light)

    def _pixels(self, samples: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Return the samples of each pixel, HxSxWxS."""
        height, width, side = self.info.height, self.info.width, self.samples
        return np.asarray(samples.reshape(height, side, width, side))

    def _samples_from_map(self, optical_from_map: F64) -> F64:
        camera = camera_matrix(self.info)
        camera[:2] *= self.samples
        camera[:2, 2] += (self.samples - 1) / 2
        return np.asarray(camera @ optical_from_map[:3])

    def _lighting(self, people: Sequence[Mesh], raster: Raster) -> SceneLighting:
        maps = self._maps
        if people:
            crowd = join(people)
            jobs = [partial(shadow_map, crowd, matrix) for matrix in self._projections]
            maps = np.maximum(maps, np.stack(at_once(jobs, self.threads)))
        step = self.samples * COARSE
        height, width = raster.triangle.shape
        corners = np.empty((height // step, width // step), np.float32)
        focal = self.info.fx * self.samples
        in_bands(
            lambda first, last: corner_light(
                raster.inverse_depth, step, focal, first, last, corners
            ),
            len(corners),
            self.threads,
        )
        middle = (self.room.low_m + self.room.high_m) / 2
        half = (self.room.high_m - self.room.low_m) / 2
        return SceneLighting(
            self._lights, self._projections, maps, self._bounce, np.stack([middle, half]), corners
        )

    def _white(self) -> float:
        """Return the radiance of a white sheet in the middle of the room that faces the camera."""
        middle = (self.room.low_m + self.room.high_m) / 2
        sides = [np.array(side) for side in ([-1.0, 0, 0], [0, 0, 1.0])]
        direct = sum(direct_light(self.room, middle, side).mean() for side in sides) / 2
        walls = self._bounce[[0, 5], :, 0].mean()
        return float(WHITE * (direct + walls))
