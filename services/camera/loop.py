"""Length of one round of a source that is played again and again."""

from pathlib import Path

from common.io.recording import open_recording
from people4d.messages import CompressedRgbdFrame, RgbdFrame
from services.camera.playback import loop_period_ns
from services.camera.source import SourceFrame
from services.camera.sources import kind_of, open_source


def loop_period_s(source: str) -> float:
    """Return the time that a looping camera adds to its stamps each round [s].

    Raises:
        SourceError: The recording, ROS bag or folder cannot be read.
    """
    kind = kind_of(source)
    if kind == "plugin":
        return 0.0  # it does not end
    if kind == "recording":
        messages = open_recording(Path(source)).messages(CompressedRgbdFrame, RgbdFrame)
        stamps_ns = [message.stamp_ns for _, message in messages]
    else:
        opened = open_source(source)
        stamps_ns = [item.stamp_ns for item in opened if isinstance(item, SourceFrame)]
        opened.close()
    if not stamps_ns:
        return 0.0
    return loop_period_ns(min(stamps_ns), max(stamps_ns), len(stamps_ns)) / 1e9
