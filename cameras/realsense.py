"""Intel RealSense: D400, L500 and SR300, by pyrealsense2."""

import re
import time
from typing import Any

import numpy as np

from cameras.sdk import WAIT_MS, SdkCamera
from services.camera.calibration import camera_info, to_intrinsics
from services.camera.distortion import read_distortion
from services.camera.ros.images import millimetres
from services.camera.source import SourceFrame


class RealSense(SdkCamera):
    """A RealSense, depth aligned to colour by its SDK."""

    name = "realsense"
    module = "pyrealsense2"
    usb = re.compile(r"^8086:.*RealSense", re.IGNORECASE)

    @classmethod
    def context(cls) -> Any:
        """Return the context, the SDK's list of devices."""
        return cls.sdk().context()

    @classmethod
    def list_devices(cls) -> list[tuple[str, str]]:
        """Return the model and the serial number of each RealSense."""
        of = cls.sdk().camera_info
        found = cls.context().query_devices()
        return [(one.get_info(of.name), one.get_info(of.serial_number)) for one in found]

    def open_device(self, serial: str) -> "RealSenseDevice":
        """Start colour and depth of the same size, on the clock of the host."""
        rs, size = self.sdk(), (self.options.width, self.options.height)
        config, pipeline = rs.config(), rs.pipeline(self.context())
        config.enable_device(serial)
        config.enable_stream(rs.stream.color, *size, rs.format.rgb8, self.options.fps)
        config.enable_stream(rs.stream.depth, *size, rs.format.z16, self.options.fps)
        profile = pipeline.start(config)
        for sensor in profile.get_device().query_sensors():
            if sensor.supports(rs.option.global_time_enabled):
                sensor.set_option(rs.option.global_time_enabled, 1)
        return RealSenseDevice(rs, pipeline, profile.get_stream(rs.stream.color))


class RealSenseDevice:
    """An open RealSense."""

    def __init__(self, rs: Any, frames: Any, colour: Any) -> None:
        self._frames, self._align = frames, rs.align(rs.stream.color)
        self._hardware = rs.timestamp_domain.hardware_clock
        lens = colour.as_video_stream_profile().get_intrinsics()
        distortion = read_distortion(lens.model.name, lens.coeffs)
        matrix = np.array([lens.fx, lens.fy, lens.ppx, lens.ppy])
        intrinsics = to_intrinsics(matrix, distortion)
        self.info = camera_info(intrinsics, (lens.height, lens.width))

    def read(self) -> SourceFrame | None:
        """Return the next pair; None if none comes in time."""
        came, frames = self._frames.try_wait_for_frames(WAIT_MS)
        colour, depth = frames.get_color_frame(), frames.get_depth_frame()
        if not (came and colour and depth):
            return None
        depth = self._align.process(frames).get_depth_frame()
        return SourceFrame(
            rgb=np.array(colour.get_data()),
            depth_mm=millimetres(np.asarray(depth.get_data()) * np.float32(depth.get_units())),
            stamp_ns=self._stamp_ns(colour),
        )

    def close(self) -> None:
        """Stop the streams."""
        self._frames.stop()

    def _stamp_ns(self, frame: Any) -> int:
        """Return the time of acquisition, or of arrival if the camera's clock is not the host's."""
        if frame.get_frame_timestamp_domain() == self._hardware:
            return time.time_ns()
        return round(float(frame.get_timestamp()) * 1e6)
