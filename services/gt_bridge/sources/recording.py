"""Truth from the project's own recordings."""

from collections.abc import Iterator
from pathlib import Path

from common.io.recording import open_recording
from people4d.messages import Truth
from services.gt_bridge.config import GtBridgeConfig


class RecordingTruth:
    """The Truth messages of a recording.

    Raises:
        SourceError: The file is absent or is no recording.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        self._recording = open_recording(Path(config.truth))

    def __iter__(self) -> Iterator[Truth]:
        """Yield the messages in the order in which they were recorded."""
        for _, message in self._recording.messages(Truth):
            if isinstance(message, Truth):
                yield message
