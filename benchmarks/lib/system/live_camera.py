"""The shipped recording as a camera with frames in memory.

Reading, decoding and the simulated depth sensor would take as much time as the pipeline without the
network, and the sensor loads Numba. They run before, in the process of the benchmark.
"""

import atexit
import pickle
import tempfile
import time
from collections.abc import Iterator
from functools import cache
from itertools import count, islice
from pathlib import Path

from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.source import Source, SourceFrame

DEMO = Path(__file__).parents[3] / "deploy" / "demo" / "crossing.mcap"


@cache
def frames_file(frames: int, stride: int = 1) -> str:
    """Return the path of a file with frames of the recording; it is deleted at the end."""
    recording = RecordingSource(DEMO, RecordingOptions())
    shown = (item for item in recording if isinstance(item, SourceFrame))
    content = recording.info, recording.transforms, list(islice(shown, 0, frames * stride, stride))
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    path = Path(folder.name) / "frames.pickle"
    path.write_bytes(pickle.dumps(content))
    return str(path)


class StoredDemo(Source):
    """Frames of a file of `frames_file`, with their own stamps."""

    def __init__(self, path: str) -> None:
        self.info, self.transforms, self._frames = pickle.loads(Path(path).read_bytes())

    def __iter__(self) -> Iterator[SourceFrame]:
        """Yield the frames in order."""
        return iter(self._frames)


class LiveDemo(StoredDemo):
    """The same at any rate, each frame stamped when it is released."""

    live = True

    def __init__(self, path: str, rate_hz: float = 10.0) -> None:
        super().__init__(path)
        self._period_s = 1 / rate_hz

    def __iter__(self) -> Iterator[SourceFrame]:
        """Yield frames at their times, endlessly."""
        begin_s = time.monotonic()
        for number in count():
            time.sleep(max(0.0, begin_s + number * self._period_s - time.monotonic()))
            frame = self._frames[number % len(self._frames)]
            yield SourceFrame(frame.rgb, frame.depth_mm, time.time_ns())
