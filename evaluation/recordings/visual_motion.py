"""Visual odometry of a recording, in place of its wheel odometry."""

import os
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import services.visual_odometry
from common.io.recording import RecordingWriter, open_recording
from evaluation.cache import SHARED_CODE, code_digest, key_of
from people4d.messages import Detections, Message, MovingTransform, Odometry, RgbdFrame
from services.camera.calibration import static_transform
from services.camera.config import CameraConfig
from services.camera.source import SourceFrame
from services.camera.sources import open_source
from services.visual_odometry.build import build
from services.visual_odometry.config import VisualOdometryConfig

Notes: TypeAlias = Mapping[str, Mapping[str, str]]
NO_NOTES: Notes = MappingProxyType({})


@dataclass(frozen=True)
class FrameMotion:
    """Estimated motion at one frame."""

    stamp_ns: int  # stamp of the frame
    motion: Odometry | MovingTransform | None  # estimate, if there is one
    took_ms: float  # [ms] processor time


class VisualMotion:
    """Visual odometry on a recording; the same input gives the same output.

    The camera's mount replaces missing transforms. Detections mask people after their frame.
    SourceError if the recording cannot be read.
    """

    def __init__(
        self, camera: CameraConfig, config: VisualOdometryConfig, detections: Iterable[Message] = ()
    ) -> None:
        self._source = open_source(camera.source, camera.options)
        self._detections = {m.stamp_ns: m for m in detections if isinstance(m, Detections)}
        self._node = build(config)
        frame_id = self._source.info.frame_id
        mount = static_transform(config.child_frame_id, frame_id, camera.mount_from_optical)
        self._transforms = list(self._source.transforms) or [mount]

    @property
    def counters(self) -> dict[str, int]:
        """Counters of the node."""
        return self._node.status().counters

    def __iter__(self) -> Iterator[FrameMotion]:
        """Yield the motion at each frame."""
        info = self._source.info
        for message in (info, *self._transforms):
            self._node.handle(message, 0)
        captures = (item for item in self._source if isinstance(item, SourceFrame))
        for sequence, capture in enumerate(captures):
            frame = RgbdFrame(
                stamp_ns=capture.stamp_ns,
                sequence=sequence,
                camera=info.camera,
                rgb=capture.rgb,
                depth_mm=capture.depth_mm,
            )
            start_ns = time.process_time_ns()
            outputs = self._node.handle(frame, 0)
            if people := self._detections.get(capture.stamp_ns):
                self._node.handle(people, 0)
            took_ms = (time.process_time_ns() - start_ns) / 1e6
            motion = next((m for m in outputs if isinstance(m, Odometry | MovingTransform)), None)
            yield FrameMotion(capture.stamp_ns, motion, took_ms)
        self._source.close()


@dataclass(frozen=True)
class VisualMotionJob:
    """Visual odometry of one recording."""

    camera: CameraConfig  # source and playback
    config: VisualOdometryConfig
    detections: Path  # recording of the detections
    folder: Path  # folder of the cache


def estimate_motion(job: VisualMotionJob) -> Path:
    """Return the detections with the estimated motion, cached; SourceError without images."""
    code = code_digest((*SHARED_CODE, services.visual_odometry))
    key = key_of(job.detections.name, code, job.camera, job.config)
    path = job.folder / "motion" / f"{Path(job.camera.source).stem}-{key}.mcap"
    if path.exists():
        return path
    stored = open_recording(job.detections)
    messages = [message for _, message in stored.messages()]
    new = path.with_suffix(f".{os.getpid()}.new")
    new.parent.mkdir(parents=True, exist_ok=True)
    motions = VisualMotion(job.camera, job.config, messages)
    write_with_motion(messages, motions, new, stored.metadata)
    new.replace(path)
    return path


def write_with_motion(
    messages: Iterable[Message], motions: Iterable[FrameMotion], path: Path, notes: Notes = NO_NOTES
) -> None:
    """Write a recording's messages and notes with estimated motion in place of odometry.

    Both are in order of time; the motion of a frame precedes its detections.
    """
    pending = iter(motions)
    upcoming = next(pending, None)
    with RecordingWriter(path) as writer:
        for name, values in notes.items():
            writer.write_metadata(name, values)
        for message in messages:
            if isinstance(message, Odometry | MovingTransform):
                continue
            while upcoming and isinstance(message, Detections):
                if upcoming.stamp_ns > message.stamp_ns:
                    break
                if upcoming.motion:
                    writer.write(upcoming.motion, upcoming.stamp_ns)
                upcoming = next(pending, None)
            writer.write(message, message.stamp_ns)
