"""A live camera with three standing people."""

import time
from collections.abc import Iterator
from itertools import islice

from common.io.images import decompress
from common.io.recording import open_recording
from deploy.cli.system.demo import DEMO
from people4d.messages import CameraInfo, CompressedRgbdFrame
from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.source import MotionMessage, Source, SourceFrame

RATE_HZ = 15.0
FRAME = 84  # index of a frame of the shipped recording with three people
PEOPLE = 3


class Standing(Source):
    """Sends one frame of the shipped recording endlessly, stamped with the present time."""

    live = True
    rate_hz = RATE_HZ

    def __init__(self) -> None:
        recording = RecordingSource(DEMO, RecordingOptions(depth_sensor="off"))
        self.info: CameraInfo = recording.info
        self.transforms = recording.transforms
        # Only one frame is decompressed, so that a restarted camera is ready sooner.
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
            yield SourceFrame(self._shown.rgb, self._shown.depth_mm, time.time_ns())
