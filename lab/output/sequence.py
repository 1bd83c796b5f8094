"""What a rendering is made of: the messages of each frame and of the whole scenario."""

import heapq
from collections.abc import Iterable, Iterator
from functools import cached_property, lru_cache
from itertools import chain
from typing import Literal

import msgspec

from common.io.images import encode_jpeg, encode_png16
from lab.camera.frames import FrameRenderer, RenderSettings, odometry, transforms
from lab.camera.synthetic_detections import SyntheticDetections, SyntheticDetectionsConfig
from lab.depth.config import DepthSensorConfig
from lab.depth.metadata import SimulationMetadata
from lab.drawing.renderer import DepthView
from lab.scenario import Scenario
from lab.truth.files import Arrays, frame_arrays
from lab.truth.frames import person_views
from lab.truth.motion_capture import capture_truth
from lab.world import World
from people4d.messages import CompressedRgbdFrame, Detections, Message

Fidelity = Literal["geometry", "depth", "colour"]

PNG_LEVEL = 6  # a seventh smaller than 3; 9 gains a tenth more and takes eight times as long


class ErrorModels(msgspec.Struct, frozen=True, kw_only=True):
    """How what is simulated errs."""

    sensor: DepthSensorConfig = DepthSensorConfig()  # of depth, applied now or on playing
    detector: SyntheticDetectionsConfig = SyntheticDetectionsConfig()  # of the fidelity geometry


class RenderJob(msgspec.Struct, frozen=True, kw_only=True):
    """What is rendered; the result depends on nothing else."""

    scenario: Scenario
    seed: int
    fidelity: Fidelity = "colour"  # geometry: detections in place of frames; depth: flat colours
    depth: Literal["clean", "measured"] = "clean"  # clean: the sensor is applied on playing
    errors: ErrorModels = ErrorModels()
    quality: int = 90  # of JPEG
    samples: int = 2  # see RenderSettings
    truth_per_frame: bool = False

    @property
    def note(self) -> SimulationMetadata:
        """What a recording says of its origin."""
        return SimulationMetadata(
            scenario=self.scenario.name, seed=self.seed, depth=self.depth, sensor=self.errors.sensor
        )


class SequenceRenderer:
    """Makes the frames of an order.

    Args:
        order: What is rendered.
    """

    def __init__(self, order: RenderJob) -> None:
        self.world = World(order.scenario, order.seed)
        self._order = order
        settings = RenderSettings(
            colour="drawn" if order.fidelity == "colour" else "flat",
            sensor=order.errors.sensor if order.depth == "measured" else None,
            samples=order.samples,
        )
        self._film = FrameRenderer(self.world, settings)

    def frame(self, index: int) -> tuple[Message, Arrays | None]:
        """Return the message of a frame, and what is true in it if that was ordered."""
        order = self._order
        if order.fidelity == "geometry" and not order.truth_per_frame:
            return self._sighting(index), None
        view = self._film.view(index)
        seen = self._sighting(index) if order.fidelity == "geometry" else self._picture(index, view)
        return seen, self._truth(index, view) if order.truth_per_frame else None

    def timeline(self, frames: Iterable[Message]) -> Iterator[Message]:
        """Return calibration and transforms, then all that happens by its stamp."""
        world = self.world
        # Of equal stamps what the frame may need comes first.
        timed = heapq.merge(
            odometry(world), capture_truth(world), frames, key=lambda message: message.stamp_ns
        )
        return chain([world.info], transforms(world), timed)

    def _picture(self, index: int, view: DepthView) -> CompressedRgbdFrame:
        world, film, order = self.world, self._film, self._order
        depth_mm = film.depth_mm(index, view)
        return CompressedRgbdFrame(
            stamp_ns=world.stamp_ns(index),
            sequence=index,
            camera=world.info.camera,
            rgb_jpeg=encode_jpeg(film.rgb(index, view), order.quality),
            depth_png=encode_png16(depth_mm, PNG_LEVEL, smooth=order.depth == "clean"),
        )

    def _sighting(self, index: int) -> Detections:
        """Return what a detector would have found."""
        world = self.world
        t_s = world.frame_s(index)
        people = world.keypoints_m(t_s)
        return self._sightings.at(people, world.optical_from_map(t_s), world.stamp_ns(index), index)

    def _truth(self, index: int, view: DepthView) -> Arrays:
        people = person_views(self.world, self.world.frame_s(index), view)
        return frame_arrays(self.world, index, people, view)

    @cached_property
    def _sightings(self) -> SyntheticDetections:
        return SyntheticDetections(self._order.errors.detector, self.world.info, self._order.seed)


@lru_cache(maxsize=1)
def sequence_renderer(order: RenderJob) -> SequenceRenderer:
    """Return the studio of an order; a process makes it once for all pieces it works on."""
    return SequenceRenderer(order)
