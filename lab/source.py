"""The virtual lab as a camera: frames are drawn when they are wanted."""

import heapq
import os
from collections.abc import Iterator
from typing import Any, Literal, Protocol

import msgspec

from common.config import Config
from lab.camera.frames import FrameRenderer, RenderSettings, odometry, transforms
from lab.depth.config import DepthSensorConfig
from lab.depth.metadata import with_errors
from lab.scenario import load_scenario, split_seed
from lab.truth.motion_capture import capture_truth
from lab.world import World
from people4d.messages import Truth
from services.camera.source import Source, SourceItem

MAX_NS = 2**63 - 1  # later than any stamp


class LabOptions(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What can be chosen in a scenario."""

    mode: Literal["colour", "depth"] = (
        "colour"  # depth: people in one colour each, ten times as fast
    )
    threads: int = 0  # that draw; 0: one for each core
    samples: int = 2  # along each side of a pixel, 1 or 2; 1 is quicker, with ragged edges
    depth_sensor: Literal["auto", "off"] = "auto"  # off: depth without the errors of a sensor
    sensor: dict[str, Any] = msgspec.field(default_factory=dict)  # changes of DepthSensorConfig


class LabSource(Source):
    """Films a scenario. It is a recording in nature: the same frames every time, at any speed.

    Args:
        name: Scenario that ships or path of a scenario's file, with @SEED for a seed of one's own.
        options: How it is filmed.

    Raises:
        ConfigError: There is no such scenario, or an option is out of range.
    """

    options_type = LabOptions

    def __init__(self, name: str, options: LabOptions) -> None:
        scenario, seed = split_seed(name)
        self._world = World(load_scenario(scenario), seed)
        self._film = FrameRenderer(self._world, _settings(options))
        self.info = self._world.info
        self.transforms = transforms(self._world)

    def __iter__(self) -> Iterator[SourceItem]:
        """Yield frames and odometry by their stamps."""
        return self.part(0.0, 0.0)

    def part(self, start_s: float, duration_s: float) -> Iterator[SourceItem]:
        """Yield frames and odometry of some time; what is left out is not drawn."""
        world = self._world
        first_ns = world.stamp_ns(0) + int(start_s * 1e9)
        last_ns = first_ns + int(duration_s * 1e9) if duration_s else MAX_NS
        indices = [
            index
            for index in range(world.frame_count)
            if first_ns <= world.stamp_ns(index) <= last_ns
        ]
        frames: Iterator[SourceItem] = map(self._film.capture, indices)
        told = [m for m in odometry(world) if first_ns <= m.stamp_ns <= last_ns]
        return heapq.merge(told, frames, key=lambda item: item.stamp_ns)


def _settings(options: LabOptions) -> RenderSettings:
    sensor = with_errors(DepthSensorConfig(), options.sensor)
    return RenderSettings(
        colour="drawn" if options.mode == "colour" else "flat",
        sensor=sensor if options.depth_sensor == "auto" else None,
        samples=options.samples,
        threads=options.threads or len(os.sched_getaffinity(0)),
    )


class LabConfig(Protocol):
    """What `LabTruth` reads of the configuration of the ground-truth bridge."""

    @property
    def truth(self) -> str:
        """Name of a scenario, or path of its file."""


class LabTruth:
    """Truth of a scenario, as a source of the ground-truth bridge.

    Its name there is "lab.source:LabTruth".

    Args:
        config: Its `truth` names the scenario as the camera's `source` does.

    Raises:
        ConfigError: There is no such scenario, or it cannot be read.
    """

    def __init__(self, config: LabConfig) -> None:
        name, seed = split_seed(config.truth.removeprefix("lab:"))
        self._world = World(load_scenario(name), seed)

    def __iter__(self) -> Iterator[Truth]:
        """Yield the messages by rising stamp."""
        return capture_truth(self._world)
