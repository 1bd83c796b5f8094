"""Orbbec Gemini, Femto and Astra, by pyorbbecsdk2."""

import re
from typing import Any

import numpy as np

from cameras.sdk import WAIT_MS, SdkCamera
from services.camera.calibration import camera_info, to_intrinsics
from services.camera.distortion import read_distortion
from services.camera.ros.images import millimetres
from services.camera.source import SourceFrame

ANY = 0  # width and height of the depth chosen by the SDK


class Orbbec(SdkCamera):
    """An Orbbec camera, depth aligned to colour by its SDK."""

    name = "orbbec"
    module = "pyorbbecsdk"
    usb = re.compile(r"^2bc5:")

    @classmethod
    def list_devices(cls) -> list[tuple[str, str]]:
        """Return the model and the serial number of each camera."""
        found = cls.sdk().Context().query_devices()
        return [
            (found.get_device_name_by_index(k), found.get_device_serial_number_by_index(k))
            for k in range(found.get_count())
        ]

    def open_device(self, serial: str) -> "OrbbecDevice":
        """Start colour, and depth in the size preferred by the SDK."""
        ob, options = self.sdk(), self.options
        context = ob.Context()
        pipeline = ob.Pipeline(context.query_devices().get_device_by_serial_number(serial))
        of_colour = pipeline.get_stream_profile_list(ob.OBSensorType.COLOR_SENSOR)
        of_depth = pipeline.get_stream_profile_list(ob.OBSensorType.DEPTH_SENSOR)
        colour = of_colour.get_video_stream_profile(
            options.width, options.height, ob.OBFormat.RGB, options.fps
        )
        depth = of_depth.get_video_stream_profile(ANY, ANY, ob.OBFormat.Y16, options.fps)
        config = ob.Config()
        config.enable_stream(colour)
        config.enable_stream(depth)
        config.set_frame_aggregate_output_mode(ob.OBFrameAggregateOutputMode.FULL_FRAME_REQUIRE)
        pipeline.enable_frame_sync()
        pipeline.start(config)
        return OrbbecDevice(ob, pipeline, colour)


class OrbbecDevice:
    """An open Orbbec camera."""

    def __init__(self, ob: Any, pipeline: Any, colour: Any) -> None:
        self._pipeline = pipeline
        self._align = ob.AlignFilter(align_to_stream=ob.OBStreamType.COLOR_STREAM)
        lens, d = colour.get_intrinsic(), colour.get_distortion()
        coefficients = (d.k1, d.k2, d.p1, d.p2, d.k3, d.k4, d.k5, d.k6)
        distortion = read_distortion("rational_polynomial", coefficients)
        matrix = np.array([lens.fx, lens.fy, lens.cx, lens.cy])
        intrinsics = to_intrinsics(matrix, distortion)
        self.info = camera_info(intrinsics, (colour.get_height(), colour.get_width()))

    def read(self) -> SourceFrame | None:
        """Return the next pair; None if none comes in time."""
        frames = self._pipeline.wait_for_frames(WAIT_MS)
        if frames is None:
            return None
        aligned = self._align.process(frames).as_frame_set()
        colour, depth = aligned.get_color_frame(), aligned.get_depth_frame()
        size = depth.get_height(), depth.get_width()
        raw = np.frombuffer(depth.get_data(), np.uint16).reshape(size)
        rgb = np.frombuffer(colour.get_data(), np.uint8)
        # Time of acquisition on the host's clock if the camera has it, else of arrival
        stamp_us = colour.get_global_timestamp_us() or colour.get_system_timestamp_us()
        return SourceFrame(
            rgb=rgb.reshape(colour.get_height(), colour.get_width(), 3).copy(),
            depth_mm=millimetres(raw * np.float32(depth.get_depth_scale() / 1000)),
            stamp_ns=stamp_us * 1000,
        )

    def close(self) -> None:
        """Stop the streams."""
        self._pipeline.stop()
