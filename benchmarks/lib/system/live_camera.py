"""The shipped recording as a camera with frames in memory.

Reading, decoding and the simulated depth sensor would take as much time as the pipeline without the
network.
"""

import time
from collections.abc import Iterator
from itertools import count, islice
from pathlib import Path

from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.source import Source, SourceFrame

DEMO = Path(__file__).parents[3] / "deploy" / "demo" / "crossing.mcap"


class LiveDemo(Source):
    """Frames of the recording at any rate, each stamped when it is released."""

    live = True

    def __init__(self, rate_hz: float = 10.0, frames: int = 24, stride: int = 5) -> None:
        recording = RecordingSource(DEMO, RecordingOptions())
        self.info, self.transforms = recording.info, recording.transforms
        shown = (item for item in recording if isinstance(item, SourceFrame))
        self._frames = list(islice(shown, 0, frames * stride, stride))
        self._period_s = 1 / rate_hz

    def __iter__(self) -> Iterator[SourceFrame]:
        """Yield frames at their times, endlessly."""
        begin_s = time.monotonic()
        for number in count():
            time.sleep(max(0.0, begin_s + number * self._period_s - time.monotonic()))
            frame = self._frames[number % len(self._frames)]
            yield SourceFrame(frame.rgb, frame.depth_mm, time.time_ns())


class StoredDemo(Source):
    """Frames of the recording from memory, with their own stamps."""

    def __init__(self, frames: int = 75) -> None:
        recording = RecordingSource(DEMO, RecordingOptions())
        self.info, self.transforms = recording.info, recording.transforms
        shown = (item for item in recording if isinstance(item, SourceFrame))
        self._frames = list(islice(shown, frames))

    def __iter__(self) -> Iterator[SourceFrame]:
        """Yield the frames in order."""
        return iter(self._frames)
