"""An Intel RealSense as a camera of people4d: python -m services.camera --set source=FILE:CLASS."""

from collections.abc import Iterator

import numpy as np
import pyrealsense2 as rs  # type: ignore[import-not-found]  # pip install pyrealsense2

from people4d.messages import CameraInfo
from services.camera.source import Source, SourceFrame


class RealSense(Source):
    """Colour and depth of a RealSense, depth aligned to colour; options come from the config."""

    live = True

    def __init__(
        self, serial: str = "", width: int = 640, height: int = 480, fps: int = 30
    ) -> None:
        config = rs.config()
        if serial:
            config.enable_device(serial)
        config.enable_stream(rs.stream.color, width, height, rs.format.rgb8, fps)
        config.enable_stream(rs.stream.depth, width, height, rs.format.z16, fps)
        self._pipeline, self._align = rs.pipeline(), rs.align(rs.stream.color)
        profile = self._pipeline.start(config)
        self._mm = profile.get_device().first_depth_sensor().get_depth_scale() * 1000
        lens = profile.get_stream(rs.stream.color).as_video_stream_profile().get_intrinsics()
        self.info = CameraInfo(
            stamp_ns=0, sequence=0, camera="camera", frame_id="camera_color_optical_frame",
            width=width, height=height, fx=lens.fx, fy=lens.fy, cx=lens.ppx, cy=lens.ppy,
            distortion_model="plumb_bob", distortion=tuple(lens.coeffs),
        )  # fmt: skip

    def __iter__(self) -> Iterator[SourceFrame]:
        """Yield frames as they come; the stamps are on the host's clock."""
        while True:
            frames = self._align.process(self._pipeline.wait_for_frames(2000))
            rgb = np.array(frames.get_color_frame().get_data())
            depth = np.rint(np.array(frames.get_depth_frame().get_data()) * self._mm)
            yield SourceFrame(rgb, depth.astype(np.uint16), round(frames.get_timestamp() * 1e6))

    def close(self) -> None:
        """Stop the camera."""
        self._pipeline.stop()
