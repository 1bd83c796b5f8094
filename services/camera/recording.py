"""RGB-D frames from the project's own recordings."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from common.io.images import decompress
from common.io.recording import open_recording
from lab.depth.note import CleanDepth, read_note
from people4d.errors import DecodeError, SourceError
from people4d.messages import (
    CameraInfo,
    CompressedRgbdFrame,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
)
from services.camera.source import MotionMessage, Source, SourceFrame

M = TypeVar("M", bound=Message)


class RecordingOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What can be chosen in a recording."""

    camera: str = ""  # name of the camera to play; may be empty where there is only one
    # Simulated recordings hold depth without errors. auto: the errors of a depth sensor are added,
    # those that the recording names; off: depth comes as stored.
    depth_sensor: Literal["auto", "off"] = "auto"
    sensor: dict[str, Any] = {}  # errors to change, see lab.depth_config.DepthSensorConfig


class RecordingSource(Source):
    """Plays one camera of a recording, with its calibration, transforms and odometry.

    Args:
        path: The file.
        options: Which camera, and what becomes of simulated depth.

    Raises:
        SourceError: The file is not a recording, or has no such camera, or is simulated and its
            note of that is damaged.
        ConfigError: The errors of the depth sensor cannot be changed so.
    """

    def __init__(self, path: Path, options: RecordingOptions) -> None:
        self.counters: Counter[str] = Counter()
        self._recording = open_recording(path)
        infos = {info.camera: info for info in self._all(CameraInfo)}
        self._camera = options.camera or next(iter(infos), "")
        if self._camera not in infos or (len(infos) > 1 and not options.camera):
            names = ", ".join(infos) or "none"
            raise SourceError(
                f"recording {path}: expected the calibration of one camera, got {names}",
                "Set options.camera to one of them." if infos else "Record camera_info too.",
            )
        self.info = infos[self._camera]
        self.note = read_note(self._recording) if options.depth_sensor == "auto" else None
        self._clean = None
        if self.note and self.note.depth == "clean":
            self._clean = CleanDepth(self.note, self.info, options.sensor)
        placed = {transform.child: transform for transform in self._all(StaticTransform)}
        own = placed.pop(self.info.frame_id, None)
        cameras = {info.frame_id for info in infos.values()}
        rest = [transform for child, transform in placed.items() if child not in cameras]
        self.transforms = [own, *rest] if own else []

    def __iter__(self) -> Iterator[SourceFrame | MotionMessage]:
        """Yield frames and odometry in the order in which they were recorded."""
        kinds = (CompressedRgbdFrame, RgbdFrame, MovingTransform, Odometry)
        for _, message in self._recording.messages(*kinds):
            if isinstance(message, Odometry | MovingTransform):
                yield message
            elif getattr(message, "camera", "") == self._camera:
                capture = self._capture(message)
                if capture:
                    yield capture
        self.counters["bad_messages"] = self._recording.bad_messages
        self.counters["cut_short"] = int(self._recording.summary.truncated)

    def _capture(self, message: Message) -> SourceFrame | None:
        try:
            frame = decompress(message) if isinstance(message, CompressedRgbdFrame) else message
            if not isinstance(frame, RgbdFrame):
                return None
            depth_mm = frame.depth_mm
            if self._clean:
                depth_mm = self._clean.measure(depth_mm, frame.stamp_ns)
        except DecodeError:
            self.counters["bad_images"] += 1
            return None
        return SourceFrame(frame.rgb, depth_mm, frame.stamp_ns)

    def _all(self, kind: type[M]) -> Iterator[M]:
        for _, message in self._recording.messages(kind):
            if isinstance(message, kind):
                yield message
