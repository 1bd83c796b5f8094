"""A RealSense in software: frames that a program gives to the SDK."""

import ctypes
import importlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

SERIAL = "021422060123"
WIDTH, HEIGHT = 64, 48
FX, CX, CY = 60.0, 31.5, 23.5
UNIT_M = 0.0005  # unit of depth [m]
FIRST_MS, PERIOD_MS = 1_700_000_000_000.0, 100.0


def import_sdk() -> Any:
    """Import the SDK, with the library of USB from PyPI where the system has none."""
    with suppress(ImportError):
        path = str(importlib.import_module("libusb_package").get_library_path())
        ctypes.CDLL(path, mode=ctypes.RTLD_GLOBAL)
    return pytest.importorskip("pyrealsense2", reason="the SDK of RealSense is not installed")


class SoftRealSense:
    """Colour and depth of a software device, matched as by a camera.

    Args:
        rs: The SDK.
        file: Recording to write; None for none.
    """

    def __init__(self, rs: Any, file: Path | None = None) -> None:
        self._rs, self._device = rs, rs.software_device()
        self._device.register_info(rs.camera_info.serial_number, SERIAL)
        self._device.register_info(rs.camera_info.name, "RealSense in software")
        self._sensors = [self._device.add_sensor(name) for name in ("Depth", "Color")]
        depth, colour = self._sensors
        self._profiles = [
            depth.add_video_stream(self._stream(rs.stream.depth, rs.format.z16, 2)),
            colour.add_video_stream(self._stream(rs.stream.color, rs.format.rgb8, 3)),
        ]
        depth.add_read_only_option(rs.option.depth_units, UNIT_M)
        same = rs.extrinsics()
        same.rotation, same.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [0, 0, 0]
        self._profiles[0].register_extrinsics_to(self._profiles[1], same)
        self._device.create_matcher(rs.matchers.default)
        # The recorder wraps the device, whose sensors pass on the frames.
        self._recorder = rs.recorder(str(file), self._device) if file else None
        self._outputs = (self._recorder or self._device).query_sensors()
        self.frames = rs.syncer()
        for sensor in self._outputs:
            sensor.open(sensor.get_stream_profiles()[0])
            sensor.start(self.frames)
        self.colour = self._profiles[1]

    def send(self, number: int, value: int, domain: Any) -> None:
        """Send one pair with a single value of depth and of colour."""
        depth = np.full((HEIGHT, WIDTH), value, np.uint16)
        rgb = np.full((HEIGHT, WIDTH, 3), (value % 256, 2, 3), np.uint8)
        pairs = zip(self._sensors, self._profiles, (depth, rgb), (2, 3), strict=True)
        for sensor, profile, image, pixel_bytes in pairs:
            frame = self._rs.software_video_frame()
            frame.pixels, frame.stride, frame.bpp = image, WIDTH * pixel_bytes, pixel_bytes
            frame.timestamp, frame.domain = FIRST_MS + number * PERIOD_MS, domain
            frame.frame_number, frame.profile = number, profile.as_video_stream_profile()
            if pixel_bytes == 2:
                frame.depth_units = UNIT_M
            sensor.on_video_frame(frame)

    def stop(self) -> None:
        """End the streams, and close the recording."""
        for sensor in self._outputs:
            sensor.stop()
            sensor.close()
        self._outputs, self._recorder = [], None

    def _stream(self, kind: Any, form: Any, pixel_bytes: int) -> Any:
        lens = self._rs.intrinsics()
        lens.width, lens.height, lens.ppx, lens.ppy = WIDTH, HEIGHT, CX, CY
        lens.fx = lens.fy = FX
        lens.model, lens.coeffs = self._rs.distortion.brown_conrady, [0.1, -0.2, 0.01, 0.0, 0.05]
        stream = self._rs.video_stream()
        stream.type, stream.fmt, stream.bpp, stream.fps = kind, form, pixel_bytes, 10
        stream.index, stream.uid = 0, pixel_bytes
        stream.width, stream.height, stream.intrinsics = WIDTH, HEIGHT, lens
        return stream
