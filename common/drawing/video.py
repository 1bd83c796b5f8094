"""Videos for all browsers: VP9 in WebM, by PyAV.

The OpenCV wheels cannot encode H.264, and their VP8 takes 57 ms for a frame of 640x480 without a
real-time mode; VP9 in real-time mode takes 6 ms.
"""

from fractions import Fraction
from pathlib import Path

import av
from av.video.stream import VideoStream

from people4d.errors import People4dError
from people4d.messages import U8

SUFFIX = ".webm"
REAL_TIME = {"deadline": "realtime", "cpu-used": "8"}
BITS_A_PIXEL = 0.4
RATE_STEP_HZ = 1000  # denominator of frame rates


class VideoWriter:
    """Writes one video; People4dError if the file cannot be written."""

    def __init__(self, path: Path, rate_hz: float, size_px: tuple[int, int]) -> None:
        if path.suffix != SUFFIX:
            raise People4dError(f"video {path} has an unsupported format", f"Name it *{SUFFIX}.")
        self._path = path
        try:
            self._container = av.open(str(path), "w")
        except (OSError, av.FFmpegError) as error:
            raise self._failure(error) from error
        rate = Fraction(round(rate_hz * RATE_STEP_HZ), RATE_STEP_HZ)
        self._stream: VideoStream = self._container.add_stream("libvpx-vp9", rate, REAL_TIME)
        self._stream.width, self._stream.height = size_px
        self._stream.pix_fmt = "yuv420p"
        self._stream.thread_count = 1
        self._stream.bit_rate = int(size_px[0] * size_px[1] * rate_hz * BITS_A_PIXEL)

    def write(self, image: U8) -> None:
        """Append an image (HxWx3, red first, of its size); People4dError if that fails."""
        self._mux(av.VideoFrame.from_ndarray(image, format="rgb24"))

    def close(self) -> None:
        """Finish the file; raises as `write` does."""
        self._mux(None)
        self._container.close()

    def _mux(self, frame: av.VideoFrame | None) -> None:
        try:
            self._container.mux(self._stream.encode(frame))
        except (OSError, av.FFmpegError) as error:
            raise self._failure(error) from error

    def _failure(self, error: Exception) -> People4dError:
        problem = f"video {self._path} cannot be written: {error}"
        return People4dError(problem, "Is the folder there and writable, and the disk not full?")
