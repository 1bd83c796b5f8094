"""What the camera of the virtual lab takes: any frame, in any order, always the same."""

from functools import cached_property
from typing import Literal

import msgspec
import numpy as np
from msgspec.structs import replace

from common.drawing.palette import PEOPLE, Colour
from lab.camera.wheels import wheel_odometry
from lab.depth.config import DepthSensorConfig
from lab.depth.sensor import DepthSensor
from lab.drawing.renderer import DepthView, Instant, Renderer, draw_depth
from lab.world import EPOCH_NS, World
from people4d.messages import F64, U8, U16, Odometry, StaticTransform
from services.camera.ros.images import millimetres
from services.camera.source import SourceFrame

BLURRED = 5  # moments that a picture with blurred motion is the mean of
FAR_M = 8.0  # from which on the flat picture is darkest
DARK = 0.4  # of its brightness there
ROOM: Colour = (120, 124, 130)


class RenderSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How frames are made."""

    colour: Literal["drawn", "flat"] = "drawn"  # flat: people in one colour each, quick
    sensor: DepthSensorConfig | None = DepthSensorConfig()  # None: depth without any error
    samples: int = 2  # along each side of a pixel, 1 or 2; 1 is quicker, with ragged edges
    threads: int = 1


class FrameRenderer:
    """Takes frames of a world; what takes long is prepared when it is first needed.

    Args:
        world: What is before the camera.
        settings: How frames are made.
    """

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
        count = BLURRED if open_s > 0 else 1
        # The stamp is that of the middle of the exposure.
        times_s = [t_s + ((k + 0.5) / count - 0.5) * open_s for k in range(count)]
        moments = [
            Instant(self.world.meshes(time_s), self.world.optical_from_map(time_s))
            for time_s in times_s
        ]
        return self._renderer.exposed(moments, index)

    def view(self, index: int) -> DepthView:
        """Return true depth and owners of a frame."""
        world, sensor = self.world, self._settings.sensor
        t_s = world.frame_s(index)
        baseline_m = (sensor or DepthSensorConfig()).baseline_m
        meshes = [world.room.mesh, *world.meshes(t_s)]
        threads = self._settings.threads
        return draw_depth(meshes, world.optical_from_map(t_s), world.info, baseline_m, threads)

    def depth_mm(self, index: int, view: DepthView) -> U16:
        """Return HxW depth as the sensor reads it, or without error; 0 = no reading."""
        if self._sensor:
            stamp_s = self.world.stamp_ns(index) / 1e9
            return self._sensor.measure(view.depth_m, view.right_depth_m, stamp_s)
        return millimetres(view.depth_m)

    @cached_property
    def _renderer(self) -> Renderer:
        world, settings = self.world, self._settings
        return Renderer(world.room, world.info, world.seed, settings.threads, settings.samples)

    @cached_property
    def _sensor(self) -> DepthSensor | None:
        sensor = self._settings.sensor
        return DepthSensor(sensor, self.world.info, self.world.seed) if sensor else None


def flat(view: DepthView) -> U8:
    """Return a picture of people in one colour each and the room in grey, nearer is brighter."""
    brightness = np.maximum(1 - (1 - DARK) / np.float32(FAR_M) * view.depth_m, DARK)
    people = [PEOPLE[k % len(PEOPLE)] for k in range(255)]
    colours = np.array([ROOM, *people], np.float32)[view.owners]
    return np.asarray(colours * brightness[..., None], np.uint8)


def transforms(world: World) -> list[StaticTransform]:
    """Return where the camera is: in the map, or on the robot and where the robot set out."""
    optical = world.info.frame_id
    if not world.scenario.camera.drive:
        return [_transform("map", optical, world.map_from_optical(0.0))]
    return [
        _transform("base_link", optical, world.path.base_from_optical),
        _transform("map", "odom", world.path.map_from_base(0.0)),
    ]


def odometry(world: World) -> list[Odometry]:
    """Return what the robot's wheels tell; nothing of a camera that stands still."""
    scenario = world.scenario
    if not scenario.camera.drive:
        return []
    told = wheel_odometry(scenario.camera, world.path, scenario.duration_s, world.seed)
    return [replace(message, stamp_ns=EPOCH_NS + message.stamp_ns) for message in told]


def _transform(parent: str, child: str, matrix: F64) -> StaticTransform:
    return StaticTransform(stamp_ns=EPOCH_NS, sequence=0, parent=parent, child=child, matrix=matrix)
