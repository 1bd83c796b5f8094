"""The messages of a rendered scenario: of each frame, and of all of it in order."""

import heapq
from collections.abc import Iterable, Iterator
from functools import cached_property, lru_cache
from itertools import chain
from typing import Annotated, Literal

from msgspec import Meta

from common.config import Config
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


class ErrorModels(Config, frozen=True, kw_only=True):
    """Errors of what is simulated."""

    sensor: DepthSensorConfig = DepthSensorConfig()  # of depth, applied now or on playing
    # of the fidelity geometry
    detector: SyntheticDetectionsConfig = SyntheticDetectionsConfig()


class RenderJob(Config, frozen=True, kw_only=True):
    """A scenario to render; the result depends on nothing else."""

    scenario: Scenario
    seed: int
    # geometry: detections in place of frames; depth: flat colours
    fidelity: Fidelity = "colour"
    depth: Literal["clean", "measured"] = "clean"  # clean: the sensor is applied on playing
    errors: ErrorModels = ErrorModels()
    quality: Annotated[int, Meta(ge=1, le=100)] = 90  # of JPEG
    samples: Annotated[int, Meta(ge=1, le=2)] = 2  # see RenderSettings
    truth_per_frame: bool = False

    @property
    def metadata(self) -> SimulationMetadata:
        """Origin of the recording."""
        return SimulationMetadata(
            scenario=self.scenario.name, seed=self.seed, depth=self.depth, sensor=self.errors.sensor
        )


class SequenceRenderer:
    """Renders the messages of a job."""

    def __init__(self, job: RenderJob) -> None:
        self.world = World(job.scenario, job.seed)
        self._job = job
        settings = RenderSettings(
            colour="drawn" if job.fidelity == "colour" else "flat",
            sensor=job.errors.sensor if job.depth == "measured" else None,
            samples=job.samples,
        )
        self._frames = FrameRenderer(self.world, settings)

    def frame(self, index: int) -> tuple[Message, Arrays | None]:
        """Return the message of a frame, and its truth if the job asks for it."""
        job = self._job
        if job.fidelity == "geometry" and not job.truth_per_frame:
            return self._detections(index), None
        view = self._frames.view(index)
        geometry = job.fidelity == "geometry"
        message = self._detections(index) if geometry else self._image(index, view)
        return message, self._truth(index, view) if job.truth_per_frame else None

    def timeline(self, frames: Iterable[Message]) -> Iterator[Message]:
        """Return calibration and transforms, then all messages by their stamps."""
        world = self.world
        # Of equal stamps what the frame may need comes first.
        timed = heapq.merge(
            odometry(world), capture_truth(world), frames, key=lambda message: message.stamp_ns
        )
        return chain([world.info], transforms(world), timed)

    def _image(self, index: int, view: DepthView) -> CompressedRgbdFrame:
        world, job = self.world, self._job
        depth_mm = self._frames.depth_mm(index, view)
        return CompressedRgbdFrame(
            stamp_ns=world.stamp_ns(index),
            sequence=index,
            camera=world.info.camera,
            rgb_jpeg=encode_jpeg(self._frames.rgb(index, view), job.quality),
            depth_png=encode_png16(depth_mm, PNG_LEVEL, smooth=job.depth == "clean"),
        )

    def _detections(self, index: int) -> Detections:
        world, t_s = self.world, self.world.frame_s(index)
        people, pose = world.keypoints_m(t_s), world.optical_from_map(t_s)
        return self._detector.at(people, pose, world.stamp_ns(index), index)

    def _truth(self, index: int, view: DepthView) -> Arrays:
        people = person_views(self.world, self.world.frame_s(index), view)
        return frame_arrays(self.world, index, people, view)

    @cached_property
    def _detector(self) -> SyntheticDetections:
        return SyntheticDetections(self._job.errors.detector, self.world.info, self._job.seed)


@lru_cache(maxsize=1)
def sequence_renderer(job: RenderJob) -> SequenceRenderer:
    """Return the renderer of a job; a process makes it once for all chunks it works on."""
    return SequenceRenderer(job)
