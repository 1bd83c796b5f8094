"""A live camera before which people stand.

Its source is `benchmarks.lib.system.standing:Standing`. Its clock is wrong by the seconds in the
file that $BENCHMARK_CLOCK names, if it does.
"""

import os
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from common.io.images import decompress
from common.io.recording import open_recording
from deploy.cli.system.demo import DEMO
from people4d.messages import CameraInfo, CompressedRgbdFrame
from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.source import MotionMessage, Source, SourceFrame

RATE_HZ = 15.0
FRAME = 84  # of the shipped recording: three people, apart
PEOPLE = 3
CLOCK_VARIABLE = "BENCHMARK_CLOCK"


class Standing(Source):
    """Shows one frame of the shipped recording for ever, with the stamps of now."""

    live = True
    rate_hz = RATE_HZ

    def __init__(self) -> None:
        recording = RecordingSource(DEMO, RecordingOptions(depth_sensor="off"))
        self.info: CameraInfo = recording.info
        self.transforms = recording.transforms
        # Only one frame is unpacked: a camera that is started again is not to wait for the others.
        frames = open_recording(DEMO).messages(CompressedRgbdFrame)
        _, shown = next(islice(frames, FRAME, None))
        assert isinstance(shown, CompressedRgbdFrame)
        self._shown = decompress(shown)

    def __iter__(self) -> Iterator[SourceFrame | MotionMessage]:
        """Yield the frame at its rate."""
        due_s = time.monotonic()
        while True:
            due_s += 1 / self.rate_hz
            time.sleep(max(0.0, due_s - time.monotonic()))
            stamp_ns = time.time_ns() + _clock_error_ns()
            yield SourceFrame(self._shown.rgb, self._shown.depth_mm, stamp_ns)


def _clock_error_ns() -> int:
    file = os.environ.get(CLOCK_VARIABLE)
    return round(float(Path(file).read_text()) * 1e9) if file else 0
