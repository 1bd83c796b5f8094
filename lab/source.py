"""Virtual lab as a camera and as a source of ground truth, loaded by name."""

import heapq
import os
from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta

from common.config import Config
from lab.camera.frames import FrameRenderer, RenderSettings, odometry, transforms
from lab.catalogue import load_scenario, split_seed
from lab.depth.config import SENSORS, SensorChanges
from lab.truth.motion_capture import capture_truth
from lab.world import World
from people4d.messages import Truth
from people4d.messages.base import Count, NameOrEmpty
from services.camera.source import Source, SourceItem
from services.gt_bridge.config import GtBridgeConfig

MAX_NS = 2**63 - 1  # [ns] time after all stamps


class LabOptions(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Options of a scenario as a camera."""

    # depth: each person in one colour, ten times as fast
    mode: Literal["colour", "depth"] = "colour"
    threads: Count = 0  # number of drawing threads; 0: one per core
    # samples along each side of a pixel; 1: fast, aliased
    samples: Annotated[int, Meta(ge=1, le=2)] = 2
    depth_sensor: Literal["auto", "off"] = "auto"  # off: depth without the errors of a sensor
    sensor: SensorChanges = SensorChanges()  # changes of the errors of the depth sensor
    camera: NameOrEmpty = ""  # name of the camera; empty: the first


class LabSource(Source):
    """A scenario as a camera, deterministic like a recording.

    ConfigError if there is no such scenario, or an option is out of range.

    Args:
        name: Scenario that ships or path of a scenario's file, with @SEED for another seed.
        options: Fidelity and depth sensor.
    """

    options_type = LabOptions

    def __init__(self, name: str, options: LabOptions) -> None:
        scenario, seed = split_seed(name)
        self._world = World(load_scenario(scenario, seed), seed).view(options.camera)
        self._renderer = FrameRenderer(self._world, _settings(options, self._world))
        self.info = self._world.info
        self.transforms = transforms(self._world)

    def __iter__(self) -> Iterator[SourceItem]:
        """Yield frames and odometry by their stamps."""
        return self.part(0.0, 0.0)

    def part(self, start_s: float, duration_s: float) -> Iterator[SourceItem]:
        """Yield frames and odometry of a period; only its frames are drawn."""
        world = self._world
        first_ns = world.stamp_ns(0) + int(start_s * 1e9)
        last_ns = first_ns + int(duration_s * 1e9) if duration_s else MAX_NS
        indices = [
            index
            for index in range(world.frame_count)
            if first_ns <= world.stamp_ns(index) <= last_ns
        ]
        frames: Iterator[SourceItem] = map(self._renderer.capture, indices)
        wheels = [m for m in odometry(world) if first_ns <= m.stamp_ns <= last_ns]
        return heapq.merge(wheels, frames, key=lambda item: item.stamp_ns)


def _settings(options: LabOptions, world: World) -> RenderSettings:
    return RenderSettings(
        colour="drawn" if options.mode == "colour" else "flat",
        sensor=options.sensor.change_model(SENSORS[world.scenario.camera.depth_sensor]),
        errors=options.depth_sensor == "auto",
        samples=options.samples,
        threads=options.threads or len(os.sched_getaffinity(0)),
    )


class LabTruth:
    """Truth of a scenario, "lab.source:LabTruth" of the bridge; ConfigError if it is unreadable."""

    def __init__(self, config: GtBridgeConfig) -> None:
        name, seed = split_seed(config.truth.removeprefix("lab:"))
        self._world = World(load_scenario(name, seed), seed)

    def __iter__(self) -> Iterator[Truth]:
        """Yield the messages by rising stamp."""
        return capture_truth(self._world)
