"""Metadata of simulated recordings, and clean depth read as a camera would.

Noise is most of what depth takes on disk. So a recording may hold the true depth of each pixel and
name the sensor whose errors are to be added: every player gets what the camera would have read, the
same bytes every time.
"""

from collections.abc import Mapping
from typing import Any, Literal

import msgspec
import numpy as np

from common.io.recording import Recording
from lab.depth.config import DepthSensorConfig
from people4d.errors import ConfigError, DecodeError, SourceError
from people4d.messages import F32, U16, CameraInfo
from people4d.messages.base import Count

NAME = "lab"  # of the metadata in the recording


class SimulationMetadata(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Origin of a simulated recording."""

    scenario: str  # name of the scenario
    seed: Count  # of the scenario, and of the sensor's noise
    depth: Literal["clean", "measured"]  # clean: the sensor is applied on playing
    sensor: DepthSensorConfig = DepthSensorConfig()  # that is, or was, applied

    def texts(self) -> dict[str, str]:
        """Return the texts for `RecordingWriter.write_metadata`."""
        return {
            "scenario": self.scenario,
            "seed": str(self.seed),
            "depth": self.depth,
            "sensor": msgspec.json.encode(self.sensor).decode(),
        }


def read_metadata(recording: Recording) -> SimulationMetadata | None:
    """Return the origin of a recording; None if it is not of the virtual lab.

    Raises:
        SourceError: The metadata are damaged, or of a later version.
    """
    if NAME not in recording.metadata:
        return None
    values: dict[str, Any] = dict(recording.metadata[NAME])
    try:
        if "sensor" in values:
            values["sensor"] = msgspec.json.decode(values["sensor"])
        return msgspec.convert(values, SimulationMetadata, strict=False)
    except (msgspec.DecodeError, msgspec.ValidationError) as error:
        raise SourceError(
            f"the recording's metadata of the virtual lab cannot be read: {error}",
            "They may be of a later version; with depth_sensor=off depth is played as stored.",
        ) from error


def change_sensor(config: DepthSensorConfig, changes: Mapping[str, Any]) -> DepthSensorConfig:
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
        SourceError: The metadata are damaged, or of a later version.
        ConfigError: A change is unknown or out of range.
    """
    metadata = read_metadata(recording)
    if metadata is None or metadata.depth != "clean":
        return None
    return CleanDepthSensor(metadata, info, changes)


class CleanDepthSensor:
    """A depth sensor that reads the clean depth of one camera.

    Raises:
        ConfigError: A change of its errors is unknown or out of range.
    """

    def __init__(
        self, metadata: SimulationMetadata, info: CameraInfo, changes: Mapping[str, Any]
    ) -> None:
        # Compiled code is loaded only for recordings that need it.
        from lab.depth.sensor import DepthSensor  # noqa: PLC0415

        config = change_sensor(metadata.sensor, changes)
        self._shape = (info.height, info.width)
        self._sensor = DepthSensor(config, info, metadata.seed)

    def measure(self, depth_mm: U16, stamp_ns: int) -> U16:
        """Return the readings for HxW true depth in millimetres, 0 where nothing is.

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
