"""One method on one recording: its tracks, matched with the ground truth, and all metrics."""

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transform_history import TransformEstimate
from common.geometry.transforms import invert
from common.metrics.from_messages import hypotheses_of
from common.metrics.matching import Matching, match
from common.metrics.record import EvaluationFrame, EvaluationSequence
from common.metrics.scores import Scores, score_matching
from common.metrics.similarity import GroundDistance
from evaluation.methods import Method
from evaluation.pipeline import track_again
from evaluation.recordings.detections import mean_ms, read_tracker_input
from evaluation.recordings.ground_truth import SampledTruth
from evaluation.recordings.recordings import EvaluationRecording
from evaluation.run.start_link import with_start_link
from people4d.errors import SourceError
from people4d.messages import (
    F64,
    CameraInfo,
    Detections,
    Message,
    MovingTransform,
    Odometry,
    StaticTransform,
    Track,
    Tracks,
)
from services.tracker.cameras.poses import transform_track


@dataclass(frozen=True)
class EvaluationRun:
    """One method on one recording."""

    method: Method
    recording: EvaluationRecording
    detections: Path  # recording of the detections
    embeddings: Path | None  # recording of the embeddings; None: the tracker uses none
    truth: SampledTruth  # ground truth at the stamps of `detections`


@dataclass(frozen=True)
class RunOutput:
    """Messages of a run, matched with the truth."""

    info: CameraInfo  # calibration of the camera
    detections: tuple[Detections, ...]  # detections of each frame
    tracks: dict[int, Tracks]  # tracks of each frame, by stamp
    matching: Matching
    took_ms: float  # [ms] mean time of the tracker in a frame


@dataclass(frozen=True)
class RunScores:
    """Metrics of a run."""

    method: str
    recording: EvaluationRecording
    people: int  # number of people in the truth
    scores: Scores
    has_visibility: bool  # True if the visible share of people is known
    frames: int  # number of frames, with and without truth
    pipeline_ms: float | None  # [ms] mean time of the pipeline in a frame; None: unknown


def execute(run: EvaluationRun) -> RunOutput:
    """Track the people of a recording; SourceError without calibration or common frame."""
    messages = list(read_tracker_input(run.detections, run.embeddings))
    detections = tuple(m for m in messages if isinstance(m, Detections))
    info = next((m for m in messages if isinstance(m, CameraInfo)), None)
    if info is None or not detections:
        raise SourceError(f"{run.recording.path} has no frame with a calibration")
    frame_id, source = run.method.tracker.frame_id, str(run.recording.path)
    messages = with_start_link(messages, run.truth, info, frame_id, source)
    # Embeddings precede their detections here.
    config = msgspec.structs.replace(run.method.tracker, embedding_wait_s=0.0, reorder_wait_s=0.0)
    start_ns = time.perf_counter_ns()
    tracks = {message.stamp_ns: message for message in track_again(messages, config)}
    took_ms = (time.perf_counter_ns() - start_ns) / 1e6 / len(detections)
    _check_frame(run, tracks)
    frames = tuple(_frames(run.truth, messages, info, tracks))
    sequence = EvaluationSequence(f"{run.method.name} {run.recording.name}", frames)
    return RunOutput(info, detections, tracks, match(sequence, GroundDistance()), took_ms)


def score_run(run: EvaluationRun, output: RunOutput) -> RunScores:
    """Return the metrics of a run."""
    stages = [mean_ms(run.detections)]
    if run.embeddings:
        stages.append(mean_ms(run.embeddings))
    known = [stage for stage in stages if stage is not None]
    return RunScores(
        method=run.method.name,
        recording=run.recording,
        people=len(run.truth.ids),
        scores=score_matching(output.matching),
        has_visibility=run.truth.has_visibility,
        frames=len(output.detections),
        pipeline_ms=sum(known) + output.took_ms if len(known) == len(stages) else None,
    )


class OdometryDrift:
    """Error of a robot's estimate of its own pose, excluded from the errors of tracks.

    The estimate comes from the transforms and odometry of a recording, between the frame of the
    tracks and the optical frame of the camera.
    """

    def __init__(self, messages: Iterable[Message], frame_id: str, camera: str) -> None:
        self._ends = frame_id, camera
        self._transforms = TransformBuffer(history_s=1e9)
        for message in messages:
            if isinstance(message, StaticTransform | MovingTransform | Odometry):
                self._transforms.add_transform(message)
        self._drives = self._transforms.lookup_static(*self._ends) is None

    def correct(self, track: Track, stamp_ns: int, map_from_camera: F64 | None) -> Track:
        """Return a track of a stamp without drift, by the true pose of the camera (4x4), if known.

        The track is unchanged if the camera stands, or its true or estimated pose is unknown.
        """
        estimated = self._transforms.lookup(*self._ends, stamp_ns) if self._drives else None
        if estimated is None or map_from_camera is None:
            return track
        true_from_estimated = map_from_camera @ invert(estimated.matrix)
        return transform_track(track, TransformEstimate(true_from_estimated))


def _frames(
    truth: SampledTruth, messages: list[Message], info: CameraInfo, tracks: dict[int, Tracks]
) -> Iterator[EvaluationFrame]:
    """Yield the frames with truth and a rising stamp; trackers reject others.

    The pose of a standing camera comes from the recording if the truth has none.
    """
    drift, recorded = OdometryDrift(messages, truth.frame_id, info.frame_id), None
    for message in messages:
        if isinstance(message, StaticTransform) and message.child == info.frame_id:
            recorded = np.array(message.matrix) if message.parent == truth.frame_id else recorded
    stamps_ns = [message.stamp_ns for message in messages if isinstance(message, Detections)]
    last_ns = -math.inf
    for stamp_ns, people in zip(stamps_ns, truth.frames, strict=True):
        if people is None or stamp_ns <= last_ns:
            continue
        last_ns = stamp_ns
        pose = recorded if people.map_from_camera is None else people.map_from_camera
        own = tracks[stamp_ns].tracks if stamp_ns in tracks else ()
        yield EvaluationFrame(
            stamp_ns=stamp_ns,
            truth=people.ground_truth(info, pose),
            hypotheses=hypotheses_of(drift.correct(track, stamp_ns, pose) for track in own),
            map_from_camera=pose,
        )


def _check_frame(run: EvaluationRun, tracks: dict[int, Tracks]) -> None:
    expected = run.truth.frame_id
    got = next((message.frame_id for message in tracks.values()), expected)
    if got != expected:
        raise SourceError(
            f"truth of {run.recording.path} is in frame {expected!r}, tracks in {got!r}",
            f"Set tracker.frame_id={expected} if the recording has that transform.",
        )
