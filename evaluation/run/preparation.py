"""From methods and takes to trials: people found once for each way to see them, and the truth."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import msgspec

from common.io.recording import open_recording
from evaluation.cache import model_digest
from evaluation.methods import Method
from evaluation.pool import Pool
from evaluation.recordings.detections import DetectionFiles, DetectionJob, detect, holds_detections
from evaluation.recordings.ground_truth import SampledTruth, read_truth
from evaluation.recordings.recordings import EvaluationRecording, render_recording
from evaluation.recordings.visual_motion import VisualMotionJob, estimate_motion
from evaluation.run.run import EvaluationRun
from people4d.messages import Detections
from services.visual_odometry.config import VisualOdometryConfig

A = TypeVar("A")
B = TypeVar("B")
W = TypeVar("W")
OnProgress = Callable[[str, float], object]


@dataclass(frozen=True)
class EvaluationPlan:
    """What is evaluated.

    Args:
        methods: What is judged, each under a name of its own.
        takes: What it is judged on.
        cache: Folder of films and detections, which are made once.
        jobs: Processes at once; the result does not depend on it.
        figures: Whether figures are drawn, which takes matplotlib.
        motion: Sees the base move in its pictures; None: odometry is as recorded.
    """

    methods: tuple[Method, ...]
    takes: tuple[EvaluationRecording, ...]
    cache: Path
    jobs: int = 1
    figures: bool = True
    motion: VisualOdometryConfig | None = None


@dataclass(frozen=True)
class WorkQueue:
    """Does pieces of work and tells how far it is.

    Args:
        pool: Where they are done.
        report: Called with what is being done and the share of it that is done.
    """

    pool: Pool
    report: OnProgress

    def do(self, what: str, work: Callable[[A], B], items: Sequence[A]) -> list[B]:
        """Return the results of all pieces, in their order."""
        finished: list[int] = []

        def done(index: int) -> None:
            finished.append(index)
            self.report(what, len(finished) / len(items))

        self.report(what, 0.0)
        return self.pool.do_all(work, items, done)


def check_models(plan: EvaluationPlan) -> None:
    """Check that all models are there, before anything that takes long.

    Raises:
        ModelError: A model is unknown, or its file is absent.
    """
    if all(_shows_no_picture(take) for take in plan.takes):
        return
    for method in plan.methods:
        model_digest(method.detector)
        if method.reid:
            model_digest(method.reid)


def render_all(plan: EvaluationPlan, report: OnProgress) -> None:
    """Film all scenarios that were not filmed before.

    Raises:
        SourceError: The cache cannot be written.
    """
    for take in plan.takes:
        render_recording(take, plan.jobs, partial(_filming, report, take.name))


def runs_of(plan: EvaluationPlan, work: WorkQueue) -> list[EvaluationRun]:
    """Return all trials, method by method, with detections and truth.

    Raises:
        SourceError: A recording cannot be read, or has no truth.
        ModelError: A model is absent.
    """
    looks: dict[tuple[str, bytes], DetectionJob] = {}
    for take in plan.takes:
        for method in plan.methods:
            _ask(looks, take, method, plan.cache)
    turns = _in_turn(looks)
    seen = dict(zip(turns, work.do("detecting", detect, list(turns.values())), strict=True))
    if plan.motion:
        seen = _with_motion(plan, looks, seen, work)
    asked: dict[tuple[str, bytes], tuple[EvaluationRecording, Path]] = {}
    for take in plan.takes:
        for method in plan.methods:
            found = seen[_way(take, method)].detections
            asked.setdefault((take.name, _key(method.camera)), (take, found))
    told = dict(zip(asked, work.do("truth", _truth, list(asked.values())), strict=True))
    trials = []
    for method in plan.methods:
        for take in plan.takes:
            way = _way(take, method)
            vectors = _embeddings(looks[way], seen[way], method)
            truth = told[take.name, _key(method.camera)]
            trials.append(EvaluationRun(method, take, seen[way].detections, vectors, truth))
    return trials


def _with_motion(
    plan: EvaluationPlan,
    looks: Mapping[W, DetectionJob],
    seen: Mapping[W, DetectionFiles],
    work: WorkQueue,
) -> dict[W, DetectionFiles]:
    """Return what was seen, with the motion that pictures tell in place of odometry."""
    if plan.motion is None:
        return dict(seen)
    watches = [
        VisualMotionJob(
            msgspec.structs.replace(looks[way].camera, source=str(looks[way].source)),
            plan.motion,
            one.detections,
            plan.cache,
        )
        for way, one in seen.items()
    ]
    told = work.do("watching motion", estimate_motion, watches)
    pairs = zip(seen.items(), told, strict=True)
    return {way: replace(one, detections=path) for (way, one), path in pairs}


def _ask(
    looks: dict[tuple[str, bytes], DetectionJob],
    take: EvaluationRecording,
    method: Method,
    cache: Path,
) -> None:
    way = _way(take, method)
    wanted = looks.get(way) or DetectionJob(take.path, method.camera, method.detector, (), cache)
    if method.reid and method.reid not in wanted.reids:
        wanted = replace(wanted, reids=(*wanted.reids, method.reid))
    looks[way] = wanted


def _in_turn(looks: Mapping[W, DetectionJob]) -> dict[W, DetectionJob]:
    """Put first who is first to ask a network about a take: the others need not ask again."""
    asked: Counter[tuple[object, ...]] = Counter()
    turn = {}
    for way, wanted in looks.items():
        question = (wanted.source, *wanted.network)
        turn[way] = asked[question]
        asked[question] += 1
    return dict(sorted(looks.items(), key=lambda item: turn[item[0]]))


def _embeddings(wanted: DetectionJob, seen: DetectionFiles, method: Method) -> Path | None:
    return seen.embeddings[wanted.reids.index(method.reid)] if method.reid else None


def _truth(asked: tuple[EvaluationRecording, Path]) -> SampledTruth:
    take, detections = asked
    found = open_recording(detections).messages(Detections)
    return read_truth(take, [message.stamp_ns for _, message in found])


def _way(take: EvaluationRecording, method: Method) -> tuple[str, bytes]:
    """Return what tells one way to see one take from any other."""
    return take.name, _key(method.camera) + _key(method.detector)


def _key(record: msgspec.Struct) -> bytes:
    return msgspec.json.encode(record)


def _shows_no_picture(take: EvaluationRecording) -> bool:
    return take.order.fidelity == "geometry" if take.order else holds_detections(take.path)


def _filming(report: OnProgress, name: str, what: str, share: float) -> None:
    report(f"{what} {name}", share)
