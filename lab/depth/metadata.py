"""Metadata of simulated recordings, and the errors of a sensor added to clean depth.

Noise is most of the size of stored depth. A recording may therefore hold the true depth and a
model of the sensor, whose errors are added during playback, always with the same bytes.
"""

from collections.abc import Mapping
from typing import Any, Literal

import msgspec
import numpy as np

from common.io.recording import Recording
from lab.depth.config import DepthSensorModel, SensorChanges
from people4d.errors import ConfigError, DecodeError, SourceError
from people4d.messages import F32, U16, CameraInfo
from people4d.messages.base import Count

NAME = "lab"  # name of the metadata in the recording


class SimulationMetadata(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Origin of a simulated recording."""

    scenario: str  # name of the scenario
    seed: Count  # seed of the scenario and of the sensor's noise
    depth: Literal["clean", "measured"]  # clean: the sensor is applied during playback
    sensor: DepthSensorModel = DepthSensorModel()  # applied sensor

    def texts(self) -> dict[str, str]:
        """Return the texts for `RecordingWriter.write_metadata`."""
        return {
            "scenario": self.scenario,
            "seed": str(self.seed),
            "depth": self.depth,
            "sensor": msgspec.json.encode(self.sensor).decode(),
        }


def read_metadata(recording: Recording) -> SimulationMetadata | None:
    """Return the origin of a recording, None for a real camera; SourceError if it is unreadable."""
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


def depth_sensor_of(
    recording: Recording, info: CameraInfo, changes: Mapping[str, Any]
) -> "CleanDepthSensor | None":
    """Return the sensor to apply to a camera of a recording; None for measured depth.

    SourceError if the metadata are damaged, or of a later version; ConfigError if a change is
    unknown or out of range.
    """
    metadata = read_metadata(recording)
    if metadata is None or metadata.depth != "clean":
        return None
    return CleanDepthSensor(metadata, info, changes)


class CleanDepthSensor:
    """Depth sensor for the clean depth of one camera; ConfigError if a change is unknown."""

    def __init__(
        self, metadata: SimulationMetadata, info: CameraInfo, changes: Mapping[str, Any]
    ) -> None:
        # Compiled code is loaded only for recordings that need it.
        from lab.depth.sensor import DepthSensor  # noqa: PLC0415

        try:
            wanted = msgspec.convert(dict(changes), SensorChanges, strict=False)
        except msgspec.ValidationError as error:
            raise ConfigError(f"the depth sensor cannot be changed: {error}") from error
        self._shape = (info.height, info.width)
        self._sensor = DepthSensor(wanted.change_model(metadata.sensor), info, metadata.seed)

    def measure(self, depth_mm: U16, stamp_ns: int) -> U16:
        """Return the readings of true depth (HxW, in millimetres, 0: nothing).

        DecodeError if the size of the image differs from the calibration.
        """
        if depth_mm.shape != self._shape:
            raise DecodeError(
                f"depth image: expected {self._shape[1]}x{self._shape[0]} as the calibration "
                f"says, got {depth_mm.shape[1]}x{depth_mm.shape[0]}"
            )
        depth_m: F32 = depth_mm.astype(np.float32) / np.float32(1000)
        return self._sensor.measure(depth_m, None, stamp_ns / 1e9)
