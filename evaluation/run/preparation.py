"""Runs of methods on recordings, with detections and ground truth prepared."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias, TypeVar

import msgspec

from common.io.recording import open_recording
from evaluation.cache import model_digest
from evaluation.methods import Method
from evaluation.pool import Pool
from evaluation.recordings.detections import (
    DetectionFiles,
    DetectionJob,
    detect,
    holds_detections,
)
from evaluation.recordings.ground_truth import SampledTruth, read_truth
from evaluation.recordings.recordings import EvaluationRecording, OnProgress, render_recording
from evaluation.recordings.visual_motion import VisualMotionJob, estimate_motion
from evaluation.run.run import EvaluationRun
from people4d.messages import Detections
from services.visual_odometry.config import VisualOdometryConfig

A = TypeVar("A")
B = TypeVar("B")
Key: TypeAlias = tuple[str, bytes]  # recording, and the configuration of its detections


@dataclass(frozen=True)
class EvaluationPlan:
    """Methods and recordings of an evaluation."""

    methods: tuple[Method, ...]  # methods, each under a name of its own
    recordings: tuple[EvaluationRecording, ...]
    cache: Path  # folder of renderings and detections, which are made once
    jobs: int = 1  # processes at once; the result does not depend on it
    figures: bool = True  # True: draw figures, which takes matplotlib
    # visual odometry of the base; None: odometry is as recorded
    motion: VisualOdometryConfig | None = None


@dataclass(frozen=True)
class WorkQueue:
    """Pieces of work in a pool of processes, with their progress."""

    pool: Pool
    on_progress: OnProgress  # called with the name of the stage and the share of it that is done

    def do(self, stage: str, work: Callable[[A], B], items: Sequence[A]) -> list[B]:
        """Return the results of all pieces, in their order."""
        finished: list[int] = []

        def done(index: int) -> None:
            finished.append(index)
            self.on_progress(stage, len(finished) / len(items))

        self.on_progress(stage, 0.0)
        return self.pool.do_all(work, items, done)


def check_models(plan: EvaluationPlan) -> None:
    """Check that all models are there, before anything that takes long.

    Raises:
        ModelError: A model is unknown, or its file is absent.
    """
    if all(_has_no_images(recording) for recording in plan.recordings):
        return
    for method in plan.methods:
        model_digest(method.detector)
        if method.reid:
            model_digest(method.reid)


def render_all(plan: EvaluationPlan, on_progress: OnProgress) -> None:
    """Render all scenarios that are not in the cache.

    Raises:
        SourceError: The cache cannot be written.
    """
    for recording in plan.recordings:
        render_recording(recording, plan.jobs, partial(_rendering, on_progress, recording.name))


def runs_of(plan: EvaluationPlan, work: WorkQueue) -> list[EvaluationRun]:
    """Return all runs, method by method, with detections and truth.

    Raises:
        SourceError: A recording cannot be read, or has no truth.
        ModelError: A model is absent.
    """
    jobs = _jobs(plan)
    ordered = _network_once(jobs)
    found = dict(zip(ordered, work.do("detecting", detect, list(ordered.values())), strict=True))
    if plan.motion:
        found = _with_motion(plan.motion, plan.cache, jobs, found, work)
    wanted: dict[Key, tuple[EvaluationRecording, Path]] = {}
    for recording in plan.recordings:
        for method in plan.methods:
            detections = found[_key(recording, method)].detections
            wanted.setdefault(_truth_key(recording, method), (recording, detections))
    truths = dict(zip(wanted, work.do("truth", _truth, list(wanted.values())), strict=True))
    runs = []
    for method in plan.methods:
        for recording in plan.recordings:
            key = _key(recording, method)
            vectors = _embeddings(jobs[key], found[key], method)
            truth = truths[_truth_key(recording, method)]
            runs.append(EvaluationRun(method, recording, found[key].detections, vectors, truth))
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
    cache: Path,
    jobs: Mapping[Key, DetectionJob],
    found: Mapping[Key, DetectionFiles],
    work: WorkQueue,
) -> dict[Key, DetectionFiles]:
    """Return the detections with estimated motion in place of odometry."""
    motions = [
        VisualMotionJob(
            msgspec.structs.replace(jobs[key].camera, source=str(jobs[key].source)),
            motion,
            files.detections,
            cache,
        )
        for key, files in found.items()
    ]
    paths = work.do("estimating motion", estimate_motion, motions)
    pairs = zip(found.items(), paths, strict=True)
    return {key: replace(files, detections=path) for (key, files), path in pairs}


def _network_once(jobs: Mapping[Key, DetectionJob]) -> dict[Key, DetectionJob]:
    """Put first one job of each network and recording: the others find its output in the cache."""
    count: Counter[tuple[object, ...]] = Counter()
    rank = {}
    for key, job in jobs.items():
        network = (job.source, *job.network)
        rank[key] = count[network]
        count[network] += 1
    return dict(sorted(jobs.items(), key=lambda item: rank[item[0]]))


def _embeddings(job: DetectionJob, files: DetectionFiles, method: Method) -> Path | None:
    return files.embeddings[job.reids.index(method.reid)] if method.reid else None


def _truth(wanted: tuple[EvaluationRecording, Path]) -> SampledTruth:
    recording, detections = wanted
    found = open_recording(detections).messages(Detections)
    return read_truth(recording, [message.stamp_ns for _, message in found])


def _key(recording: EvaluationRecording, method: Method) -> Key:
    return recording.name, _encode(method.camera) + _encode(method.detector)


def _truth_key(recording: EvaluationRecording, method: Method) -> Key:
    return recording.name, _encode(method.camera)


def _encode(record: msgspec.Struct) -> bytes:
    return msgspec.json.encode(record)


def _has_no_images(recording: EvaluationRecording) -> bool:
    if recording.job:
        return recording.job.fidelity == "geometry"
    return holds_detections(recording.path)


def _rendering(on_progress: OnProgress, name: str, stage: str, share: float) -> None:
    on_progress(f"{stage} {name}", share)
