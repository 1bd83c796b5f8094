"""Runs of methods on recordings, with detections and ground truth prepared."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import msgspec

from common.io.recording import open_recording
from evaluation.annotations.truth import annotated_truth
from evaluation.cache import model_digests
from evaluation.methods import Method
from evaluation.pool import OnProgress, Pool
from evaluation.recordings.detections import DetectionFiles, DetectionJob, detect, holds_detections
from evaluation.recordings.ground_truth import SampledTruth, read_truth
from evaluation.recordings.recordings import EvaluationRecording, render_recording
from evaluation.recordings.visual_motion import VisualMotionJob, estimate_motion
from evaluation.run.run import EvaluationRun
from people4d.messages import Detections
from services.visual_odometry.config import VisualOdometryConfig

Key: TypeAlias = tuple[str, bytes]  # recording, and the configuration of its detections


@dataclass(frozen=True)
class EvaluationPlan:
    """Methods and recordings of an evaluation."""

    methods: tuple[Method, ...]  # methods with different names
    recordings: tuple[EvaluationRecording, ...]
    cache: Path  # folder of renderings and detections
    jobs: int = 1  # number of processes, without effect on the result
    figures: bool = True  # True: draw figures, which requires matplotlib
    motion: VisualOdometryConfig | None = None  # configuration; None: odometry as recorded


def check_models(plan: EvaluationPlan) -> None:
    """Check that all models exist before the evaluation; ModelError if one does not."""
    if all(_has_no_images(recording) for recording in plan.recordings):
        return
    for method in plan.methods:
        model_digests(method.detector)
        if method.reid:
            model_digests(method.reid)


def warnings_of(plan: EvaluationPlan) -> list[str]:
    """Return warnings about figures unavailable from the recordings."""
    bare = [r.name for r in plan.recordings if r.job and r.job.fidelity == "geometry"]
    embedding = [method.name for method in plan.methods if method.reid]
    if not bare:
        return []
    sentences = [
        f"--fidelity geometry: {', '.join(bare)} has no images. Detections, their positions and "
        "yaws have errors of a simulation, so that detectors and errors of positions and yaws "
        "are not evaluated, only what trackers make of them."
    ]
    if embedding:
        sentences.append(
            f"--fidelity geometry has no appearance: {', '.join(embedding)} tracks by position "
            "alone and re-identifies no one. Its ID switches, re-identification and false "
            "positives say nothing about it; --fidelity colour does."
        )
    return sentences


def render_all(plan: EvaluationPlan, on_progress: OnProgress) -> None:
    """Render the scenarios that are not in the cache; SourceError if it cannot be written."""
    for recording in plan.recordings:

        def rendering(stage: str, share: float, name: str = recording.name) -> object:
            return on_progress(f"{stage} {name}", share)

        render_recording(recording, plan.jobs, rendering)


def runs_of(plan: EvaluationPlan, pool: Pool) -> list[EvaluationRun]:
    """Return all runs, method by method, with detections and truth.

    SourceError if a recording cannot be read, or has no truth; ModelError if a model is absent.
    """
    jobs = _jobs(plan)
    found = dict(zip(jobs, pool.do("detecting", detect, list(jobs.values())), strict=True))
    if plan.motion:
        found = _with_motion(plan.motion, jobs, found, pool)
    pairs = [(method, recording) for method in plan.methods for recording in plan.recordings]
    wanted: dict[Key, tuple[EvaluationRecording, Path, Method]] = {}
    for method, recording in pairs:
        key = recording.name, _encode(method.camera)
        wanted.setdefault(key, (recording, found[_key(recording, method)].detections, method))
    truths = dict(zip(wanted, pool.do("truth", _truth, list(wanted.values())), strict=True))
    runs = []
    for method, recording in pairs:
        key = _key(recording, method)
        files, reid = found[key], method.reid
        embeddings = files.embeddings[jobs[key].reids.index(reid)] if reid else None
        truth = truths[recording.name, _encode(method.camera)]
        runs.append(EvaluationRun(method, recording, files.detections, embeddings, truth))
    return runs


def _jobs(plan: EvaluationPlan) -> dict[Key, DetectionJob]:
    jobs: dict[Key, DetectionJob] = {}
    for recording in plan.recordings:
        for method in plan.methods:
            key = _key(recording, method)
            job = jobs.get(key) or DetectionJob(
                recording.path, method.camera, method.detector, (), plan.cache
            )
            if method.reid and method.reid not in job.reids:
                job = replace(job, reids=(*job.reids, method.reid))
            jobs[key] = job
    return jobs


def _with_motion(
    motion: VisualOdometryConfig,
    jobs: Mapping[Key, DetectionJob],
    found: Mapping[Key, DetectionFiles],
    pool: Pool,
) -> dict[Key, DetectionFiles]:
    """Return the detections with estimated motion in place of odometry."""
    motions = []
    for key, files in found.items():
        job = jobs[key]
        camera = msgspec.structs.replace(job.camera, source=str(job.source))
        motions.append(VisualMotionJob(camera, motion, files.detections, job.folder))
    paths = pool.do("estimating motion", estimate_motion, motions)
    pairs = zip(found.items(), paths, strict=True)
    return {key: replace(files, detections=path) for (key, files), path in pairs}


def _truth(wanted: tuple[EvaluationRecording, Path, Method]) -> SampledTruth:
    recording, detections, method = wanted
    messages = [message for _, message in open_recording(detections).messages()]
    stamps_ns = [message.stamp_ns for message in messages if isinstance(message, Detections)]
    if recording.annotations is None:
        return read_truth(recording, stamps_ns)
    camera = msgspec.structs.replace(method.camera, source=str(recording.path))
    frame_id = method.tracker.frame_id
    return annotated_truth(recording.annotations, camera, messages, stamps_ns, frame_id)


def _key(recording: EvaluationRecording, method: Method) -> Key:
    return recording.name, _encode(method.camera) + _encode(method.detector)


def _encode(record: msgspec.Struct) -> bytes:
    return msgspec.json.encode(record)


def _has_no_images(recording: EvaluationRecording) -> bool:
    job = recording.job
    return job.fidelity == "geometry" if job else holds_detections(recording.path)
