"""Colour images as files of one format, or as H.264 video."""

from fractions import Fraction
from typing import Literal, get_args

import av
import cv2
import numpy as np
from av.video.codeccontext import VideoCodecContext

from common.io.images import decode_jpeg, encode_jpeg
from people4d.errors import ConfigError
from people4d.messages import U8, CompressedRgbdFrame, RgbdFrame

ColourFormat = Literal["jpeg", "png", "h264"]
FORMATS: tuple[ColourFormat, ...] = get_args(ColourFormat)

QUALITY = 80  # of JPEG
GROUP = 30  # frames from one that is complete to the next, so that viewers can seek
# One frame in, one out: no frame waits for a later one.
H264 = {"preset": "veryfast", "tune": "zerolatency", "crf": "23", "x264-params": "repeat-headers=1"}
CAMERAS_MAX = 16  # with an encoder


class ColourEncoder:
    """Encodes the colour of frames; of H.264, each camera has a stream of its own.

    ConfigError if there is no such format, or no H.264 encoder in this build of PyAV.
    """

    def __init__(self, colour_format: str) -> None:
        if colour_format not in FORMATS:
            raise ConfigError(
                f"there is no format {colour_format!r}", f"Formats are {', '.join(FORMATS)}."
            )
        self.format: ColourFormat = colour_format
        self._videos: dict[str, _Video] = {}
        if colour_format == "h264" and "libx264" not in av.codecs_available:
            raise ConfigError("this build of PyAV has no encoder of H.264", "Choose jpeg.")

    def encode(self, frame: RgbdFrame | CompressedRgbdFrame) -> bytes:
        """Return the encoded colour image; DecodeError if that of the frame is corrupt."""
        if isinstance(frame, CompressedRgbdFrame):
            if self.format == "jpeg":
                return frame.rgb_jpeg
            rgb = decode_jpeg(frame.rgb_jpeg)
        else:
            rgb = frame.rgb
        if self.format == "jpeg":
            return encode_jpeg(rgb, QUALITY)
        if self.format == "png":
            bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
            return cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
        return self._encode_video(frame.camera, rgb)

    def _encode_video(self, camera: str, rgb: U8) -> bytes:
        size = rgb.shape[1] // 2 * 2, rgb.shape[0] // 2 * 2  # H.264 halves the colour
        video = self._videos.get(camera)
        if video is None or video.size != size:
            while len(self._videos) >= CAMERAS_MAX:
                del self._videos[next(iter(self._videos))]
            video = self._videos[camera] = _Video(size)
        return video.encode(rgb[: size[1], : size[0]])


class _Video:
    """A stream of H.264, Annex B, whose every packet is one frame."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        codec = av.CodecContext.create("libx264", "w")
        assert isinstance(codec, VideoCodecContext)
        codec.width, codec.height = size
        codec.pix_fmt = "yuv420p"
        codec.time_base = Fraction(1, 30)
        codec.gop_size, codec.max_b_frames, codec.thread_count = GROUP, 0, 1
        codec.options = H264
        self._codec, self._count = codec, 0

    def encode(self, rgb: U8) -> bytes:
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(rgb), format="rgb24")
        frame.pts = self._count
        self._count += 1
        return b"".join(bytes(packet) for packet in self._codec.encode(frame))
