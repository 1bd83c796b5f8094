"""Frames of a simulated camera, deterministic and in any order."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from msgspec.structs import replace

from common.drawing.strokes import PEOPLE, Colour
from lab.camera.image_drift import ImageDrift
from lab.camera.wheels import wheel_odometry
from lab.depth.config import SENSORS, DepthSensorModel
from lab.depth.sensor import DepthSensor
from lab.drawing.renderer import DepthView, Instant, Renderer, draw_depth, draw_surfaces
from lab.world import EPOCH_NS, World
from people4d.messages import F64, U8, U16, Odometry, StaticTransform
from services.camera.ros.images import millimetres
from services.camera.source import SourceFrame

BLUR_SAMPLES = 5  # number of instants in an image with motion blur
FAR_M = 8.0  # depth at which the flat image is darkest [m]
DARK = 0.4  # relative brightness at that depth
ROOM: Colour = (120, 124, 130)


@dataclass(frozen=True, kw_only=True)
class RenderSettings:
    """Fidelity of rendered frames."""

    colour: Literal["drawn", "flat"] = "drawn"  # flat: each person in one colour, fast
    sensor: DepthSensorModel | None = None  # depth sensor; None: as in the scenario
    errors: bool = True  # False: depth without sensor errors
    samples: int = 2  # samples along each side of a pixel: 1 (fast, aliased) or 2
    threads: int = 1


class FrameRenderer:
    """Renders frames of a world; slow preparations wait for their first use."""

    def __init__(self, world: World, settings: RenderSettings) -> None:
        self.world = world
        self._settings = settings

    def capture(self, index: int) -> SourceFrame:
        """Return a frame."""
        view = self.view(index)
        return SourceFrame(
            self.rgb(index, view), self.depth_mm(index, view), self.world.stamp_ns(index)
        )

    def rgb(self, index: int, view: DepthView) -> U8:
        """Return HxWx3 colour, red first; motion is blurred while the shutter is open."""
        if self._settings.colour == "flat":
            return flat(view)
        t_s, open_s = self.world.frame_s(index), self.world.scenario.camera.exposure_s
        count = BLUR_SAMPLES if open_s > 0 else 1
        # The stamp is the middle of the exposure.
        times_s = [t_s + ((k + 0.5) / count - 0.5) * open_s for k in range(count)]
        instants = [
            Instant(self.world.surfaces(time_s), self.world.optical_from_map(time_s))
            for time_s in times_s
        ]
        settings = self._drift.at(t_s)
        return self._renderer.exposed(instants, index, settings)

    def view(self, index: int) -> DepthView:
        """Return true depth and owners of a frame."""
        return self._view_at(self.world.frame_s(index))

    def depth_mm(self, index: int, view: DepthView) -> U16:
        """Return HxW depth with or without the errors of the sensor; 0: no reading.

        Args:
            index: Number of the frame.
            view: True depth of the frame.
        """
        world, lag_s = self.world, self.world.scenario.camera.depth_lag_s
        t_s, stamp_s = world.frame_s(index) - lag_s, world.stamp_ns(index) / 1e9
        if self._settings.errors and self._config.sees_surfaces:
            meshes, pose = [world.room.mesh, *world.surfaces(t_s)], world.optical_from_map(t_s)
            threads = self._settings.threads
            surfaces = draw_surfaces(meshes, pose, world.info, self._config, threads)
            return self._sensor.measure(
                surfaces.depth_m, surfaces.right_depth_m, stamp_s, surfaces.light
            )
        if lag_s:
            view = self._view_at(t_s)
        if self._settings.errors:
            return self._sensor.measure(view.depth_m, view.right_depth_m, stamp_s)
        return millimetres(view.depth_m)

    def _view_at(self, t_s: float) -> DepthView:
        world = self.world
        meshes = [world.room.mesh, *world.surfaces(t_s)]
        pose, threads = world.optical_from_map(t_s), self._settings.threads
        return draw_depth(meshes, pose, world.info, self._config.baseline_m, threads)

    @property
    def _config(self) -> DepthSensorModel:
        return self._settings.sensor or SENSORS[self.world.scenario.camera.depth_sensor]

    @cached_property
    def _renderer(self) -> Renderer:
        world, settings = self.world, self._settings
        return Renderer(
            world.room, world.info, world.noise_seed, settings.threads, settings.samples
        )

    @cached_property
    def _drift(self) -> ImageDrift:
        return ImageDrift(self.world.scenario.camera.image, self.world.noise_seed)

    @cached_property
    def _sensor(self) -> DepthSensor:
        return DepthSensor(self._config, self.world.info, self.world.noise_seed)


def flat(view: DepthView) -> U8:
    """Return an image of people in one colour each and the room in grey, darker at distance."""
    brightness = np.maximum(1 - (1 - DARK) / np.float32(FAR_M) * view.depth_m, DARK)
    people = [PEOPLE[k % len(PEOPLE)] for k in range(255)]
    colours = np.array([ROOM, *people], np.float32)[view.owners]
    return np.asarray(colours * brightness[..., None], np.uint8)


def transforms(world: World) -> list[StaticTransform]:
    """Return the pose of the camera in the map, or on the robot with the robot's first pose."""
    optical = world.info.frame_id
    if not world.scenario.camera.drive:
        return [_transform("map", optical, world.map_from_optical(0.0))]
    return [
        _transform("base_link", optical, world.path.base_from_optical),
        _transform("map", "odom", world.path.map_from_base(0.0)),
    ]


def odometry(world: World) -> list[Odometry]:
    """Return the odometry of the robot's wheels; empty for a static camera."""
    scenario = world.scenario
    if not scenario.camera.drive:
        return []
    messages = wheel_odometry(world.path, scenario.duration_s, world.noise_seed)
    clock_s = scenario.camera.clock_s
    late_ns = [round((clock_s(m.stamp_ns / 1e9) - m.stamp_ns / 1e9) * 1e9) for m in messages]
    return [
        replace(message, stamp_ns=EPOCH_NS + message.stamp_ns + ns)
        for message, ns in zip(messages, late_ns, strict=True)
    ]


def _transform(parent: str, child: str, matrix: F64) -> StaticTransform:
    return StaticTransform(stamp_ns=EPOCH_NS, sequence=0, parent=parent, child=child, matrix=matrix)
