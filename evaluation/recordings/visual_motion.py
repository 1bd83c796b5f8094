"""What the pictures of a recording tell of its camera's motion, in place of its odometry."""

import os
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import msgspec

from common.io.recording import RecordingWriter, open_recording
from evaluation.cache import code_digest, key_of
from people4d.messages import (
    CameraInfo,
    Detections,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
)
from services.camera.calibration import static_transform
from services.camera.config import CameraConfig
from services.camera.source import SourceFrame
from services.camera.sources import open_source
from services.visual_odometry.build import build
from services.visual_odometry.config import VisualOdometryConfig

CODE = (
    *("people4d/**/*.py", "common/*.py", "common/geometry/*.py", "common/io/*.py"),
    *("services/camera/**/*.py", "services/visual_odometry/*.py"),
)
Notes: TypeAlias = Mapping[str, Mapping[str, str]]
NO_NOTES: Notes = MappingProxyType({})


@dataclass(frozen=True)
class FrameMotion:
    """What one frame told.

    Args:
        stamp_ns: Of the frame.
        motion: What was told of it; None: nothing.
        took_ms: Processor time.
    """

    stamp_ns: int
    motion: Odometry | MovingTransform | None
    took_ms: float


class VisualMotion:
    """Works through a recording without any odometry, the same way every time.

    Args:
        camera: How it is played; its mount is used where the recording has no transforms.
        config: Of the visual odometry.
        found: Detections of its frames, whose people are left out as soon as their frame was seen;
            nobody is, if there are none.

    Raises:
        SourceError: It cannot be read.
    """

    def __init__(
        self, camera: CameraConfig, config: VisualOdometryConfig, found: Iterable[Message] = ()
    ) -> None:
        self._source = open_source(camera.source, camera.kind, camera.options)
        self._found = {m.stamp_ns: m for m in found if isinstance(m, Detections)}
        self._node = build(config)
        frame_id = self._source.info.frame_id
        hangs = static_transform(config.child_frame_id, frame_id, camera.mount_from_optical)
        self._transforms = list(self._source.transforms) or [hangs]

    @property
    def counters(self) -> dict[str, int]:
        """What was counted."""
        return self._node.status().counters

    def __iter__(self) -> Iterator[FrameMotion]:
        """Yield what each frame tells."""
        info = self._source.info
        for message in (info, *self._transforms):
            self._node.handle(message, 0)
        captures = (item for item in self._source if isinstance(item, SourceFrame))
        for sequence, capture in enumerate(captures):
            yield self._see(capture, info, sequence)
        self._source.close()

    def _see(self, capture: SourceFrame, info: CameraInfo, sequence: int) -> FrameMotion:
        frame = RgbdFrame(
            stamp_ns=capture.stamp_ns,
            sequence=sequence,
            camera=info.camera,
            rgb=capture.rgb,
            depth_mm=capture.depth_mm,
        )
        start_ns = time.process_time_ns()
        told = self._node.handle(frame, 0)
        people = self._found.get(capture.stamp_ns)
        if people:
            self._node.handle(people, 0)
        took_ms = (time.process_time_ns() - start_ns) / 1e6
        motion = next((m for m in told if isinstance(m, Odometry | MovingTransform)), None)
        return FrameMotion(capture.stamp_ns, motion, took_ms)


@dataclass(frozen=True)
class VisualMotionJob:
    """What is watched for its motion.

    Args:
        camera: How it is played.
        config: Of the visual odometry.
        detections: Recording of what was found in it.
        folder: Where results are kept.
    """

    camera: CameraConfig
    config: VisualOdometryConfig
    detections: Path
    folder: Path


def estimate_motion(wanted: VisualMotionJob) -> Path:
    """Return the detections with the motion that pictures tell, unless they were watched before.

    Raises:
        SourceError: The recording has no pictures.
    """
    records = map(msgspec.to_builtins, (wanted.camera, wanted.config))
    key = key_of(wanted.detections.name, code_digest(CODE), *records)
    path = wanted.folder / "motion" / f"{Path(wanted.camera.source).stem}-{key}.mcap"
    if path.exists():
        return path
    stored = open_recording(wanted.detections)
    messages = [message for _, message in stored.messages()]
    new = path.with_suffix(f".{os.getpid()}.new")
    new.parent.mkdir(parents=True, exist_ok=True)
    write_with_motion(
        messages, VisualMotion(wanted.camera, wanted.config, messages), new, stored.metadata
    )
    new.replace(path)
    return path


def write_with_motion(
    messages: Iterable[Message], seen: Iterable[FrameMotion], path: Path, notes: Notes = NO_NOTES
) -> None:
    """Write a recording again, with the motion that its pictures tell for what it had.

    Args:
        messages: Of the recording, by time.
        seen: By time; the motion of a frame comes before all else of its time.
        path: The new recording.
        notes: Of the recording.
    """
    waiting = iter(seen)
    upcoming = next(waiting, None)
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
                upcoming = next(waiting, None)
            writer.write(message, message.stamp_ns)
