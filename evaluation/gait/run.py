"""Gait estimation on a recording, in one process."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.runtime.node import Node
from evaluation.methods import Method
from evaluation.pipeline import lockstep, pipeline, play
from people4d.errors import SourceError
from people4d.messages import (
    CameraInfo,
    Detections,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
    Skeletons,
    StaticTransform,
)
from services.camera.config import CameraConfig
from services.gait.build import build
from services.gait.cascade import PersonObservation
from services.gait.config import GaitConfig
from services.gait.estimator import (
    ESTIMATOR_COUNTERS,
    GaitEstimator,
    GaitFrame,
    GaitResult,
    OnFrame,
)
from services.skeleton.build import build as build_skeleton
from services.skeleton.config import SkeletonConfig

OnSkeletons = Callable[[Skeletons], None]
BoxCorners = tuple[float, float, float, float]  # [px] left, top, right, bottom
UNLIMITED_S = 1e9
FRAME_ID = "map"


@dataclass(frozen=True)
class GaitRun:
    """A run of gait estimation on a recording."""

    source: str  # recording, bag, folder or lab:SCENARIO
    method: Method  # detection and tracking; with `box` only playback
    gait: GaitConfig
    # Box of one person in the first frame, tracked by colour alone; None: all detected people
    box: BoxCorners | None


def estimate_gait(
    run: GaitRun, on_frame: OnFrame, on_skeletons: OnSkeletons | None = None
) -> Iterator[int]:
    """Estimate the gait in a recording; yield the stamp of each frame.

    `on_skeletons` gets the skeletons of all frames; there are none with a box.

    Raises:
        SourceError: The source cannot be played, or no body is in the box.
        ModelError: A model is absent.
    """
    camera = lockstep(msgspec.structs.replace(run.method.camera, source=run.source))
    if run.box is None:
        return _estimate_all(camera, run, on_frame, on_skeletons)
    return _estimate_box(camera, run, on_frame)


def tracking_nodes(method: Method) -> list[Node]:
    """Return the nodes of a method; frames wait for their embeddings, since time stands still."""
    tracker = msgspec.structs.replace(method.tracker, reorder_wait_s=0.0)
    return pipeline(method.detector, method.reid, tracker)


def _estimate_all(
    camera: CameraConfig, run: GaitRun, on_frame: OnFrame, on_skeletons: OnSkeletons | None
) -> Iterator[int]:
    nodes = [*tracking_nodes(run.method), build(run.gait, on_frame)]
    if on_skeletons:
        nodes.append(build_skeleton(SkeletonConfig()))
    for step in play(camera, nodes):
        for message in step.messages:
            if on_skeletons and isinstance(message, Skeletons):
                on_skeletons(message)
        yield from (m.stamp_ns for m in step.messages if isinstance(m, RgbdFrame))


def _estimate_box(camera: CameraConfig, run: GaitRun, on_frame: OnFrame) -> Iterator[int]:
    transforms = TransformBuffer()
    counters = Counter(dict.fromkeys(ESTIMATOR_COUNTERS, 0))
    observation = PersonObservation(id=1, box_xyxy_px=np.array(run.box, np.float64))
    estimator: GaitEstimator | None = None
    info: CameraInfo | None = None
    config = colour_only(run.gait)
    for step in play(camera, [_EmptyDetector()]):
        for message in step.messages:
            if isinstance(message, StaticTransform | MovingTransform | Odometry):
                transforms.add_transform(message)
            elif isinstance(message, CameraInfo):
                info, estimator = message, GaitEstimator(config, message, counters)
            elif isinstance(message, RgbdFrame) and info and estimator:
                pose = transforms.camera_pose(FRAME_ID, info.frame_id, message.stamp_ns)
                if pose is None:
                    continue
                image = message.rgb, message.depth_mm
                frame = GaitFrame(message.stamp_ns, *image, (observation,), pose)
                results = estimator.update_people(frame)
                _check_results(results, observation)
                on_frame(info, frame, results or ())
                observation = PersonObservation(id=1)
                yield message.stamp_ns


def colour_only(config: GaitConfig) -> GaitConfig:
    """Return the configuration in which colour tracks a box without limit, as published."""
    cascade = msgspec.structs.replace(config.cascade, carry_s=UNLIMITED_S, colour_distance_max=1.0)
    return msgspec.structs.replace(config, cascade=cascade)


def _check_results(results: Sequence[GaitResult] | None, observation: PersonObservation) -> None:
    """Check that the person of the first frame can be tracked."""
    if results is None:
        raise SourceError("the size of the frames differs from the calibration")
    found = results and any(point.state != "lost" for point in results[0].person.points)
    if observation.box_xyxy_px is not None and not found:
        raise SourceError(
            "no person is in that box of the first frame",
            "Write it as left,top,right,bottom in pixels, or leave it out: --person auto.",
        )


class _EmptyDetector(Node):
    """Answers each frame with empty detections, so that lock-step playback continues."""

    inputs: tuple[type[Message], ...] = (RgbdFrame,)

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Return empty detections."""
        if not isinstance(message, RgbdFrame):
            return ()
        height, width = message.rgb.shape[:2]
        empty = Detections(
            stamp_ns=message.stamp_ns,
            sequence=message.sequence,
            camera=message.camera,
            frame_id=message.camera,
            model="none",
            width=width,
            height=height,
        )
        return [empty]
