"""A live camera before which people stand.

Its source is `benchmarks.lib.standing:Standing`.
"""

import time
from collections.abc import Iterator
from itertools import islice

from deploy.cli.system.up import DEMO
from people4d.messages import CameraInfo
from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.source import MotionMessage, Source, SourceFrame

RATE_HZ = 15.0
FRAME = 84  # of the shipped recording: three people, apart
PEOPLE = 3


class Standing(Source):
    """Shows one frame of the shipped recording for ever, with the stamps of now."""

    live = True

    def __init__(self) -> None:
        recording = RecordingSource(DEMO, RecordingOptions())
        self.info: CameraInfo = recording.info
        self.transforms = recording.transforms
        captures = (item for item in recording if isinstance(item, SourceFrame))
        self._shown = next(islice(captures, FRAME, None))

    def __iter__(self) -> Iterator[SourceFrame | MotionMessage]:
        """Yield the frame at its rate."""
        due_s = time.monotonic()
        while True:
            due_s += 1 / RATE_HZ
            time.sleep(max(0.0, due_s - time.monotonic()))
            yield SourceFrame(self._shown.rgb, self._shown.depth_mm, time.time_ns())
