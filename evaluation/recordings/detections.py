"""Detections and embeddings of a recording, computed once for all trackers."""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import msgspec

from common.io.odometry_order import odometry_first
from common.io.recording import RecordingWriter, open_recording
from evaluation.cache import (
    DETECTOR_CODE,
    REID_CODE,
    code_digest,
    content_digest,
    key_of,
    model_digests,
)
from evaluation.pipeline import PipelineStep, lockstep, play
from people4d.errors import SourceError
from people4d.messages import (
    CameraInfo,
    Crops,
    Detections,
    Embeddings,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
)
from services.camera.config import CameraConfig
from services.camera.sources import kind_of
from services.detector.build import build as build_detector
from services.detector.config import DetectorConfig
from services.reid.build import build as build_reid
from services.reid.config import ReidConfig

SPEED = "speed"  # metadata with the mean time of a stage
TRACKER_INPUT = (CameraInfo, StaticTransform, MovingTransform, Odometry, Detections)


@dataclass(frozen=True)
class DetectionJob:
    """Detection and embedding of the people in one recording."""

    source: Path  # recording, bag or folder
    camera: CameraConfig  # playback
    detector: DetectorConfig
    reids: tuple[ReidConfig, ...]  # one recording of embeddings for each
    folder: Path  # folder of the cache

    def file(self, content: str, reid: ReidConfig | None = None) -> Path:
        """Return the file of the detections, or of the embeddings of one of `reids`, by digest."""
        digest = code_digest(DETECTOR_CODE if reid is None else REID_CODE)
        parts = [content, digest, self.camera, self.detector, model_digests(self.detector)]
        if reid:
            parts += [reid, model_digests(reid)]
        kind = "embeddings" if reid else "detections"
        return self.folder / kind / f"{self.source.stem}-{key_of(*parts)}.mcap"


@dataclass(frozen=True)
class DetectionFiles:
    """Recordings of a detection job."""

    detections: Path  # recording with calibration, transforms, odometry and detections
    embeddings: tuple[Path, ...]  # one recording for each of the job's `reids`


def holds_detections(source: Path) -> bool:
    """Check that a recording holds detections in place of frames."""
    if kind_of(str(source)) != "recording":
        return False
    topics = open_recording(source).summary.topics
    frames = any(topic.startswith("raw/") for topic in topics)
    return not frames and any(topic.startswith("detections/") for topic in topics)


def detect(job: DetectionJob) -> DetectionFiles:
    """Detect and embed the people in a recording, unless the cache has the result.

    SourceError if the recording cannot be read, or has more than one camera; ModelError if a model
    is absent.
    """
    if holds_detections(job.source):
        return DetectionFiles(job.source, tuple(job.source for _ in job.reids))
    content = content_digest(job.source)
    files = [job.file(content), *(job.file(content, reid) for reid in job.reids)]
    if not all(file.exists() for file in files):
        _run(job, files)
    return DetectionFiles(files[0], tuple(files[1:]))


def read_tracker_input(detections: Path, embeddings: Path | None) -> Iterator[Message]:
    """Yield the input of a tracker, each frame's embeddings before its detections."""
    found = open_recording(embeddings).messages(Embeddings) if embeddings else ()
    vectors = {message.stamp_ns: message for _, message in found}
    cameras = set()
    recorded = (message for _, message in open_recording(detections).messages(*TRACKER_INPUT))
    for message in odometry_first(recorded):
        if isinstance(message, Detections):
            cameras.add(message.camera)
            if len(cameras) > 1:
                raise SourceError(f"{detections} has several cameras", "Evaluate one at a time.")
            if message.stamp_ns in vectors:
                yield vectors[message.stamp_ns]
        yield message


def mean_ms(path: Path) -> float | None:
    """Return the mean time of a frame from the metadata of a recording; None if unknown."""
    text = open_recording(path).metadata.get(SPEED, {}).get("mean_ms", "")
    return float(text) if text else None


def _run(job: DetectionJob, files: Sequence[Path]) -> None:
    camera = lockstep(msgspec.structs.replace(job.camera, source=str(job.source.absolute())))
    embedders = [build_reid(reid) for reid in job.reids]
    new = [file.with_suffix(f".{os.getpid()}.new") for file in files]
    took_ms: list[list[float]] = [[] for _ in files]
    with ExitStack() as stack:
        writers = [stack.enter_context(RecordingWriter(path)) for path in new]
        for step in play(camera, [build_detector(job.detector)]):
            for message in step.messages:
                if isinstance(message, TRACKER_INPUT):
                    writers[0].write(_without_trace(message), message.stamp_ns)
                if isinstance(message, RgbdFrame):
                    others_ms = _stage_ms(step, "send") + _stage_ms(step, "crops")
                    took_ms[0].append(step.duration_ms - others_ms)
                if not isinstance(message, Crops):
                    continue
                for k, embedder in enumerate(embedders, 1):
                    start_ns = time.perf_counter_ns()
                    answers = embedder.handle(message, 0)
                    answer_ms = (time.perf_counter_ns() - start_ns) / 1e6
                    took_ms[k].append(answer_ms + _stage_ms(step, "crops"))
                    for answer in answers:
                        writers[k].write(_without_trace(answer), answer.stamp_ns)
        for writer, times in zip(writers, took_ms, strict=True):
            if times:
                writer.write_metadata(SPEED, {"mean_ms": f"{sum(times) / len(times):.4f}"})
    for made, file in zip(new, files, strict=True):
        made.replace(file)


def _without_trace(message: Message) -> Message:
    """Return the message without the times of its stages, which differ from run to run."""
    return msgspec.structs.replace(message, trace=())


def _stage_ms(step: PipelineStep, stage: str) -> float:
    spans = [span for span in step.spans if span.stage.endswith(f".{stage}")]
    return sum(span.end_ns - span.start_ns for span in spans) / 1e6
