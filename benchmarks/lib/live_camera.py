"""The shipped recording as a camera that costs next to nothing: its pictures are in memory.

Reading a file, unpacking its pictures and simulating the depth sensor's errors take as much time as
the rest of the pipeline without the network; no robot does that while it drives.
"""

import time
from collections.abc import Iterator
from itertools import count, islice
from pathlib import Path

from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.source import Source, SourceFrame

DEMO = Path(__file__).parents[2] / "deploy" / "demo" / "crossing.mcap"


class LiveDemo(Source):
    """Shows pictures of the recording at a rate of its own, each stamped when it is shown.

    Args:
        rate_hz: Pictures in a second.
        pictures: How many of the recording are kept in memory, and shown again and again.
        stride: Pictures of the recording from one to the next.
    """

    live = True

    def __init__(self, rate_hz: float = 10.0, pictures: int = 24, stride: int = 5) -> None:
        recording = RecordingSource(DEMO, RecordingOptions())
        self.info, self.transforms = recording.info, recording.transforms
        shown = (item for item in recording if isinstance(item, SourceFrame))
        self._pictures = list(islice(shown, 0, pictures * stride, stride))
        self._period_s = 1 / rate_hz

    def __iter__(self) -> Iterator[SourceFrame]:
        """Yield pictures at their time, for ever."""
        begin_s = time.monotonic()
        for number in count():
            time.sleep(max(0.0, begin_s + number * self._period_s - time.monotonic()))
            picture = self._pictures[number % len(self._pictures)]
            yield SourceFrame(picture.rgb, picture.depth_mm, time.time_ns())


class StoredDemo(Source):
    """Plays the recording from memory: its first pictures, with the stamps they were taken at.

    Args:
        pictures: How many of the recording are kept in memory.
    """

    def __init__(self, pictures: int = 75) -> None:
        recording = RecordingSource(DEMO, RecordingOptions())
        self.info, self.transforms = recording.info, recording.transforms
        shown = (item for item in recording if isinstance(item, SourceFrame))
        self._pictures = list(islice(shown, pictures))

    def __iter__(self) -> Iterator[SourceFrame]:
        """Yield the pictures in order."""
        return iter(self._pictures)
