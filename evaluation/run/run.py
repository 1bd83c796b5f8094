"""One method on one recording: its tracks beside the ground truth, and all metrics of that."""

import time
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from common.metrics import (
    EvaluationFrame,
    EvaluationSequence,
    GroundDistance,
    Matching,
    Scores,
    hypotheses_of,
    match,
    score_matching,
)
from evaluation.methods import Method
from evaluation.pipeline import track_again
from evaluation.recordings.detections import mean_ms, read_tracker_input
from evaluation.recordings.ground_truth import SampledTruth, TruthFrame
from evaluation.recordings.recordings import EvaluationRecording
from evaluation.run.odometry_drift import OdometryDrift, transform_track
from people4d.errors import SourceError
from people4d.messages import F64, CameraInfo, Detections, Message, StaticTransform, Tracks


@dataclass(frozen=True)
class EvaluationRun:
    """One method on one recording."""

    method: Method
    recording: EvaluationRecording
    detections: Path  # recording of its detections
    embeddings: Path | None  # recording of its embeddings; None: the tracker takes none
    truth: SampledTruth  # ground truth at the stamps of `detections`


@dataclass(frozen=True)
class RunOutput:
    """Messages of a run, matched with the truth."""

    info: CameraInfo  # calibration of the camera
    detections: tuple[Detections, ...]  # detections of each frame
    tracks: dict[int, Tracks]  # tracks of each frame, by stamp
    matching: Matching
    took_ms: float  # mean time of the tracker in a frame


@dataclass(frozen=True)
class RunScores:
    """Metrics of a run."""

    method: str
    recording: EvaluationRecording
    people: int  # number of people in the truth
    scores: Scores
    has_visibility: bool  # True if the visible share of people is known
    frames: int  # number of frames, with and without truth
    pipeline_ms: float | None  # mean time of the pipeline in a frame; None where it is unknown


@dataclass(frozen=True)
class _FrameInput:
    """Data that all frames of a run share."""

    info: CameraInfo
    tracks: dict[int, Tracks]
    map_from_camera: F64 | None
    drift: OdometryDrift


def execute(run: EvaluationRun) -> RunOutput:
    """Track the people of a recording.

    Raises:
        SourceError: The recording has no calibration, or truth and tracks are in different frames.
    """
    messages = list(read_tracker_input(run.detections, run.embeddings))
    detections = tuple(m for m in messages if isinstance(m, Detections))
    info = next((m for m in messages if isinstance(m, CameraInfo)), None)
    if info is None or not detections:
        raise SourceError(f"{run.recording.path} has no frame with a calibration")
    # Embeddings come before their detections here; later ones do not exist.
    config = msgspec.structs.replace(run.method.tracker, embedding_wait_s=0.0, reorder_wait_s=0.0)
    start_ns = time.perf_counter_ns()
    tracks = {message.stamp_ns: message for message in track_again(messages, config)}
    took_ms = (time.perf_counter_ns() - start_ns) / 1e6 / len(detections)
    _check_frame(run, tracks)
    pose = _pose(messages, run.truth.frame_id, info)
    drift = OdometryDrift(messages, run.truth.frame_id, info.frame_id)
    shared = _FrameInput(info, tracks, pose, drift)
    frames = [
        _frame(shared, truth, message.stamp_ns)
        for message, truth in zip(detections, run.truth.frames, strict=True)
        if truth is not None
    ]
    sequence = EvaluationSequence(f"{run.method.name} {run.recording.name}", _in_order(frames))
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


def _frame(shared: _FrameInput, truth: TruthFrame, stamp_ns: int) -> EvaluationFrame:
    pose = shared.map_from_camera if truth.map_from_camera is None else truth.map_from_camera
    tracks = shared.tracks.get(stamp_ns)
    matrix = shared.drift.true_from_estimated(stamp_ns, pose)
    people = [transform_track(track, matrix) for track in tracks.tracks] if tracks else []
    return EvaluationFrame(
        stamp_ns=stamp_ns,
        truth=truth.ground_truth(shared.info, pose),
        hypotheses=hypotheses_of(people),
        map_from_camera=pose,
    )


def _pose(messages: list[Message], frame_id: str, info: CameraInfo) -> F64 | None:
    """Return map_from_camera from the recording; None if it is not there."""
    pose = None
    for message in messages:
        if isinstance(message, StaticTransform) and message.child == info.frame_id:
            pose = np.array(message.matrix) if message.parent == frame_id else pose
    return pose


def _in_order(frames: list[EvaluationFrame]) -> tuple[EvaluationFrame, ...]:
    """Leave out frames whose stamp does not rise: no tracker takes them."""
    ordered: list[EvaluationFrame] = []
    for frame in frames:
        if not ordered or frame.stamp_ns > ordered[-1].stamp_ns:
            ordered.append(frame)
    return tuple(ordered)


def _check_frame(run: EvaluationRun, tracks: dict[int, Tracks]) -> None:
    expected = run.truth.frame_id
    got = next((message.frame_id for message in tracks.values()), expected)
    if got != expected:
        raise SourceError(
            f"truth of {run.recording.path} is in frame {expected!r}, tracks in {got!r}",
            f"Set tracker.frame_id={expected} if the recording has that transform.",
        )
