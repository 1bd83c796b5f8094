"""Messages of a rendered scenario: of each frame, and of the whole in order."""

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import chain
from typing import Literal, TypeAlias

from common.config import Config
from common.io.images import encode_jpeg, encode_png16
from lab.camera.frames import FrameRenderer, RenderSettings, odometry, transforms
from lab.camera.synthetic_detections import SyntheticDetections, SyntheticDetectionsConfig
from lab.depth.config import SENSORS, DepthSensorModel, SensorChanges
from lab.depth.metadata import SimulationMetadata
from lab.drawing.renderer import DepthView
from lab.scenario import Scenario
from lab.truth.files import Arrays, frame_arrays
from lab.truth.frames import person_views
from lab.truth.motion_capture import capture_truth
from lab.world import World, stamp_ns
from people4d.messages import CompressedRgbdFrame, Detections, Message

Fidelity = Literal["geometry", "depth", "colour"]
TimedMessage: TypeAlias = tuple[int, Message]  # time in the recording [ns], and message

PNG_LEVEL = 6  # 1/7 smaller than level 3; level 9 is 1/10 smaller and eight times slower


class ErrorModels(Config, frozen=True, kw_only=True):
    """Errors of simulated sensors and detectors."""

    # changes of the errors of depth, applied now or during playback
    sensor: SensorChanges = SensorChanges()
    # errors of detections with fidelity geometry
    detector: SyntheticDetectionsConfig = SyntheticDetectionsConfig()


USUAL_ERRORS = ErrorModels()


@dataclass(frozen=True, kw_only=True)
class RenderJob:
    """Scenario to render; the result depends on this job only."""

    scenario: Scenario
    seed: int
    # geometry: detections in place of frames; depth: flat colours
    fidelity: Fidelity = "colour"
    # clean: the sensor is applied during playback, if it needs only depth
    depth: Literal["clean", "measured"] = "clean"
    errors: ErrorModels = USUAL_ERRORS
    quality: int = 90  # JPEG quality, 1 to 100
    samples: int = 2  # see RenderSettings
    truth_per_frame: bool = False

    @property
    def metadata(self) -> SimulationMetadata:
        """Origin of the recording."""
        return SimulationMetadata(
            scenario=self.scenario.name,
            seed=self.seed,
            depth="measured" if self.is_measured else "clean",
            sensor=self.sensor_of(self.scenario),
        )

    @property
    def is_measured(self) -> bool:
        """True: the sensor is applied now, since playback knows neither surfaces nor cameras."""
        several = bool(self.scenario.cameras)
        return self.depth == "measured" or self.sensor_of(self.scenario).sees_surfaces or several

    def sensor_of(self, view: Scenario) -> DepthSensorModel:
        """Return the errors of the depth sensor of the camera of a scenario."""
        return self.errors.sensor.change_model(SENSORS[view.camera.depth_sensor])

    def __post_init__(self) -> None:
        """Check that truth for each frame has one camera."""
        if self.truth_per_frame and self.scenario.cameras:
            raise ValueError("truth_per_frame: expected one camera, got several")


class SequenceRenderer:
    """Renders the messages of a job."""

    def __init__(self, job: RenderJob) -> None:
        self.world = World(job.scenario, job.seed)
        self._job = job
        self._cameras = [CameraRenderer(job, view) for view in self.world.views]
        # Frames of all cameras by true time
        self._frames = sorted(
            (camera.world.frame_s(index), number, index)
            for number, camera in enumerate(self._cameras)
            for index in range(camera.world.frame_count)
        )

    @property
    def frame_count(self) -> int:
        """Number of frames of all cameras."""
        return len(self._frames)

    def time_ns(self, index: int) -> int:
        """Return the true time of a frame."""
        return stamp_ns(self._frames[index][0])

    def frame(self, index: int) -> tuple[Message, Arrays | None]:
        """Return the message of a frame, and its truth if the job includes it."""
        _, number, own = self._frames[index]
        return self._cameras[number].frame(own)

    def timeline(self, frames: Iterable[TimedMessage]) -> Iterator[TimedMessage]:
        """Return calibration and transforms, then all messages, by true time."""
        world = self.world
        motion = [
            (view.time_ns(message.stamp_ns), message)
            for view in world.views
            for message in odometry(view)
        ]
        truth = ((message.stamp_ns, message) for message in capture_truth(world))
        # At equal times, odometry and truth come before frames.
        timed = heapq.merge(motion, truth, frames, key=lambda item: item[0])
        fixed = [m for view in world.views for m in (view.info, *transforms(view))]
        return chain(((message.stamp_ns, message) for message in fixed), timed)


class CameraRenderer:
    """Renders the frames of one camera of a job."""

    def __init__(self, job: RenderJob, world: World) -> None:
        self.world, self._job = world, job
        settings = RenderSettings(
            colour="drawn" if job.fidelity == "colour" else "flat",
            sensor=job.sensor_of(world.scenario),
            errors=job.is_measured,
            samples=job.samples,
        )
        self._frames = FrameRenderer(world, settings)

    def frame(self, index: int) -> tuple[Message, Arrays | None]:
        """Return the message of a frame, and its truth if the job includes it."""
        job = self._job
        if job.fidelity == "geometry" and not job.truth_per_frame:
            return self._detections(index), None
        view = self._frames.view(index)
        geometry = job.fidelity == "geometry"
        message = self._detections(index) if geometry else self._image(index, view)
        return message, self._truth(index, view) if job.truth_per_frame else None

    def _image(self, index: int, view: DepthView) -> CompressedRgbdFrame:
        world, job = self.world, self._job
        depth_mm = self._frames.depth_mm(index, view)
        return CompressedRgbdFrame(
            stamp_ns=world.stamp_ns(index),
            sequence=index,
            camera=world.info.camera,
            rgb_jpeg=encode_jpeg(self._frames.rgb(index, view), job.quality),
            depth_png=encode_png16(depth_mm, PNG_LEVEL, smooth=not job.is_measured),
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
        return SyntheticDetections(
            self._job.errors.detector, self.world.info, self.world.noise_seed
        )


@lru_cache(maxsize=1)
def sequence_renderer(job: RenderJob) -> SequenceRenderer:
    """Return the renderer of a job, shared by all chunks of a process."""
    return SequenceRenderer(job)
