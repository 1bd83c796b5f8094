"""One method on one take: its tracks beside the truth, and all figures of that."""

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
    """What is done.

    Args:
        method: What is judged.
        take: What it is judged on.
        detections: What was found in the take.
        embeddings: How those people look; None: the tracker does not ask.
        truth: At the stamps of `detections`.
    """

    method: Method
    take: EvaluationRecording
    detections: Path
    embeddings: Path | None
    truth: SampledTruth


@dataclass(frozen=True)
class RunOutput:
    """All messages of a trial, and what they are worth.

    Args:
        info: Calibration of the camera.
        detections: Of each frame.
        tracks: Of each frame, by stamp.
        matching: Tracks and truth.
        took_ms: Mean time of the tracker in a frame.
    """

    info: CameraInfo
    detections: tuple[Detections, ...]
    tracks: dict[int, Tracks]
    matching: Matching
    took_ms: float


@dataclass(frozen=True)
class RunScores:
    """The figures of a trial.

    Args:
        method: Name of the method.
        take: What it was judged on.
        people: Number of people in the truth.
        scores: All figures.
        visibility: Whether it is known how much of each person can be seen.
        frames: Number of frames, with and without truth.
        pipeline_ms: Mean time of the whole pipeline in a frame; None where it is not known.
    """

    method: str
    take: EvaluationRecording
    people: int
    scores: Scores
    visibility: bool
    frames: int
    pipeline_ms: float | None


@dataclass(frozen=True)
class _SharedInput:
    """What of a trial all frames share."""

    info: CameraInfo
    tracks: dict[int, Tracks]
    map_from_camera: F64 | None
    drift: OdometryDrift


def run(trial: EvaluationRun) -> RunOutput:
    """Track the people of a take.

    Raises:
        SourceError: The recording has no calibration, or truth and tracks are in different frames.
    """
    messages = list(read_tracker_input(trial.detections, trial.embeddings))
    detections = tuple(m for m in messages if isinstance(m, Detections))
    info = next((m for m in messages if isinstance(m, CameraInfo)), None)
    if info is None or not detections:
        raise SourceError(f"{trial.take.path} has no frame with a calibration")
    # Embeddings come before their detections here: what has not come by then never comes.
    config = msgspec.structs.replace(trial.method.tracker, embedding_wait_s=0.0, reorder_wait_s=0.0)
    start_ns = time.perf_counter_ns()
    tracks = {message.stamp_ns: message for message in track_again(messages, config)}
    took_ms = (time.perf_counter_ns() - start_ns) / 1e6 / len(detections)
    _check_frame(trial, tracks)
    pose = _pose(messages, trial.truth.frame_id, info)
    drift = OdometryDrift(messages, trial.truth.frame_id, info.frame_id)
    told = _SharedInput(info, tracks, pose, drift)
    frames = [
        _frame(told, moment, found.stamp_ns)
        for found, moment in zip(detections, trial.truth.moments, strict=True)
        if moment is not None
    ]
    sequence = EvaluationSequence(f"{trial.method.name} {trial.take.name}", _in_order(frames))
    return RunOutput(info, detections, tracks, match(sequence, GroundDistance()), took_ms)


def score_run(trial: EvaluationRun, done: RunOutput) -> RunScores:
    """Return the figures of a run."""
    stages = [mean_ms(trial.detections)]
    if trial.embeddings:
        stages.append(mean_ms(trial.embeddings))
    known = [stage for stage in stages if stage is not None]
    return RunScores(
        method=trial.method.name,
        take=trial.take,
        people=len(trial.truth.ids),
        scores=score_matching(done.matching),
        visibility=trial.truth.visibility,
        frames=len(done.detections),
        pipeline_ms=sum(known) + done.took_ms if len(known) == len(stages) else None,
    )


def _frame(done: "_SharedInput", moment: TruthFrame, stamp_ns: int) -> EvaluationFrame:
    pose = done.map_from_camera if moment.map_from_camera is None else moment.map_from_camera
    tracks = done.tracks.get(stamp_ns)
    matrix = done.drift.true_from_told(stamp_ns, pose)
    people = tuple(transform_track(track, matrix) for track in tracks.tracks) if tracks else ()
    return EvaluationFrame(
        stamp_ns=stamp_ns,
        truth=moment.true_people(done.info, pose),
        hypotheses=hypotheses_of(people),
        map_from_camera=pose,
    )


def _pose(messages: list[Message], frame_id: str, info: CameraInfo) -> F64 | None:
    """Return map_from_camera as the recording says; None if it does not."""
    pose = None
    for message in messages:
        if isinstance(message, StaticTransform) and message.child == info.frame_id:
            pose = np.array(message.matrix) if message.parent == frame_id else pose
    return pose


def _in_order(frames: list[EvaluationFrame]) -> tuple[EvaluationFrame, ...]:
    """Leave out frames whose stamp does not rise: no tracker takes them."""
    kept: list[EvaluationFrame] = []
    for frame in frames:
        if not kept or frame.stamp_ns > kept[-1].stamp_ns:
            kept.append(frame)
    return tuple(kept)


def _check_frame(trial: EvaluationRun, tracks: dict[int, Tracks]) -> None:
    told = next((message.frame_id for message in tracks.values()), trial.truth.frame_id)
    if told != trial.truth.frame_id:
        raise SourceError(
            f"truth of {trial.take.path} is in frame {trial.truth.frame_id!r}, tracks in {told!r}",
            f"Set tracker.frame_id={trial.truth.frame_id} if the recording has that transform.",
        )
