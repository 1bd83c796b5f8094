"""RGB-D frames from the project's own recordings."""

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar

from msgspec import field

from common import registry
from common.config import Config
from common.io.images import decompress
from common.io.recording import Recording, open_recording
from people4d.errors import ConfigError, DecodeError, SourceError
from people4d.messages import (
    U16,
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

# Functions that create the depth sensor of a recording, by its metadata record. Arguments are the
# recording, the calibration and changed settings of the sensor; the result is None for measured
# depth. They are given by name, since higher layers provide them.
DEPTH_SENSORS = {"lab": "lab.depth.metadata:depth_sensor_of"}


class SimulatedSensor(Protocol):
    """A depth sensor applied to the true depth in a recording."""

    def measure(self, depth_mm: U16, stamp_ns: int) -> U16:
        """Return the readings of the true depth, HxW; DecodeError if its size differs."""
        ...


class RecordingOptions(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Options of a recording."""

    camera: str = ""  # name of the camera to play; may be empty if there is only one
    # Simulated recordings have depth without errors. auto: errors of the recording's depth sensor
    # are added; off: depth as stored
    depth_sensor: Literal["auto", "off"] = "auto"
    # Changed settings of the sensor, see lab.depth.config
    sensor: dict[str, Any] = field(default_factory=dict)


class RecordingSource(Source):
    """Plays one camera of a recording, with its calibration, transforms and odometry.

    SourceError if there is no such camera or depth sensor, ConfigError for wrong settings of it.
    """

    options_type = RecordingOptions

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
        self._sensor = None
        if options.depth_sensor == "auto":
            self._sensor = _depth_sensor(self._recording, self.info, options.sensor)
        transforms = {transform.child: transform for transform in self._all(StaticTransform)}
        mount = transforms.pop(self.info.frame_id, None)
        cameras = {info.frame_id for info in infos.values()}
        rest = [transform for child, transform in transforms.items() if child not in cameras]
        self.transforms = [mount, *rest] if mount else []

    def __iter__(self) -> Iterator[SourceFrame | MotionMessage]:
        """Yield frames and motion in the order in which they were recorded."""
        types = (CompressedRgbdFrame, RgbdFrame, MovingTransform, Odometry)
        for _, message in self._recording.messages(*types):
            if isinstance(message, Odometry | MovingTransform):
                yield message
            elif (
                isinstance(message, CompressedRgbdFrame | RgbdFrame)
                and message.camera == self._camera
            ):
                frame = self._frame(message)
                if frame:
                    yield frame
        self.counters["bad_messages"] = self._recording.bad_messages
        self.counters["cut_short"] = int(self._recording.summary.truncated)

    def _frame(self, message: CompressedRgbdFrame | RgbdFrame) -> SourceFrame | None:
        try:
            frame = decompress(message) if isinstance(message, CompressedRgbdFrame) else message
            depth_mm = frame.depth_mm
            if self._sensor:
                depth_mm = self._sensor.measure(depth_mm, frame.stamp_ns)
        except DecodeError:
            self.counters["bad_images"] += 1
            return None
        return SourceFrame(frame.rgb, depth_mm, frame.stamp_ns)

    def _all(self, kind: type[M]) -> Iterator[M]:
        for _, message in self._recording.messages(kind):
            if isinstance(message, kind):
                yield message


def _depth_sensor(
    recording: Recording, info: CameraInfo, changes: Mapping[str, Any]
) -> SimulatedSensor | None:
    name = next((name for name in recording.metadata if name in DEPTH_SENSORS), None)
    if name is None:
        return None
    try:
        make = registry.find("depth sensor", DEPTH_SENSORS, name)
    except ConfigError as error:
        raise SourceError(
            f"the recording holds depth without errors: {error.problem}",
            "Set options.depth_sensor=off to play it so, or install the virtual lab.",
        ) from error
    sensor: SimulatedSensor | None = make(recording, info, changes)
    return sensor
