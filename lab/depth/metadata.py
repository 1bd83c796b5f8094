"""What a recording of the virtual lab says of itself, and clean depth read as a camera would.

Noise is most of what depth takes on disk. So a recording may hold the true depth of each pixel,
with a note of the sensor whose errors are to be added: whoever plays it gets what the camera would
have read, the same bytes every time.
"""

from collections.abc import Mapping
from typing import Any, Literal

import msgspec
import numpy as np

from common.io.recording import Recording
from lab.depth.config import DepthSensorConfig
from people4d.errors import ConfigError, DecodeError, SourceError
from people4d.messages import F32, U16, CameraInfo

NAME = "lab"  # of the note in the recording


class SimulationMetadata(msgspec.Struct, frozen=True, kw_only=True):
    """Where a simulated recording comes from."""

    scenario: str  # name of the scenario
    seed: int  # of the scenario, and of the sensor's noise
    depth: Literal["clean", "measured"]  # clean: the sensor is applied on playing
    sensor: DepthSensorConfig = DepthSensorConfig()  # that is, or was, applied

    def values(self) -> dict[str, str]:
        """Return the texts for `RecordingWriter.write_metadata`."""
        return {
            "scenario": self.scenario,
            "seed": str(self.seed),
            "depth": self.depth,
            "sensor": msgspec.json.encode(self.sensor).decode(),
        }


def read_metadata(recording: Recording) -> SimulationMetadata | None:
    """Return what a recording says of itself; None if it is not of the virtual lab.

    Raises:
        SourceError: The note is damaged, or of a later version.
    """
    if NAME not in recording.metadata:
        return None
    values: dict[str, Any] = dict(recording.metadata[NAME])
    try:
        if "sensor" in values:
            values["sensor"] = msgspec.json.decode(values["sensor"])
        note = msgspec.convert(values, SimulationMetadata, strict=False)
    except (msgspec.DecodeError, msgspec.ValidationError) as error:
        raise SourceError(
            f"the recording's note of the virtual lab cannot be read: {error}",
            "It may be of a later version; with depth_sensor=off depth is played as stored.",
        ) from error
    if note.seed < 0:
        raise SourceError(f"the recording's note of the virtual lab has a seed of {note.seed}")
    return note


def with_errors(config: DepthSensorConfig, changes: Mapping[str, Any]) -> DepthSensorConfig:
    """Return the errors of a sensor with some of them changed.

    Raises:
        ConfigError: A change is unknown or out of range.
    """
    try:
        values = {**msgspec.to_builtins(config), **changes}
        return msgspec.convert(values, DepthSensorConfig, strict=False)
    except msgspec.ValidationError as error:
        raise ConfigError(f"the depth sensor cannot be changed so: {error}") from error


def depth_sensor_of(
    recording: Recording, info: CameraInfo, changes: Mapping[str, Any]
) -> "CleanDepthSensor | None":
    """Return the sensor to apply to a camera of a recording; None if its depth has the errors.

    Raises:
        SourceError: The note is damaged, or of a later version.
        ConfigError: A change is unknown or out of range.
    """
    note = read_metadata(recording)
    return CleanDepthSensor(note, info, changes) if note and note.depth == "clean" else None


class CleanDepthSensor:
    """Reads the clean depth of one camera as a depth sensor would.

    Args:
        note: Of the recording.
        info: Calibration of the camera.
        changes: Of the sensor's errors, by name.

    Raises:
        ConfigError: A change is unknown or out of range.
    """

    def __init__(
        self, note: SimulationMetadata, info: CameraInfo, changes: Mapping[str, Any] | None = None
    ) -> None:
        # Compiled code is loaded only for recordings that need it.
        from lab.depth.sensor import DepthSensor  # noqa: PLC0415

        config = with_errors(note.sensor, changes or {})
        self._shape = (info.height, info.width)
        self._sensor = DepthSensor(config, info, note.seed)

    def measure(self, depth_mm: U16, stamp_ns: int) -> U16:
        """Return what the sensor reads.

        Args:
            depth_mm: HxW, true depth in millimetres, 0 where nothing is.
            stamp_ns: Of the frame.

        Raises:
            DecodeError: The image is not as large as the calibration says.
        """
        if depth_mm.shape != self._shape:
            raise DecodeError(
                f"depth image: expected {self._shape[1]}x{self._shape[0]} as the calibration "
                f"says, got {depth_mm.shape[1]}x{depth_mm.shape[0]}"
            )
        depth_m: F32 = depth_mm.astype(np.float32) / np.float32(1000)
        return self._sensor.measure(depth_m, None, stamp_ns / 1e9)
