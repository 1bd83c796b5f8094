"""Outputs of the recorder: one file, parts with a limit of their size, files around events."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from common.io.images import compress
from common.io.recording import RecordingWriter
from deploy.recorder.conditions import Condition
from people4d.codec import encode
from people4d.messages import Message, RgbdFrame
from people4d.topics import BY_MESSAGE

Open = Callable[[Path], RecordingWriter]

PARTS = 10  # number of parts of a recording with a limit; the oldest part is deleted as a whole
KEYS_MAX = 256  # maximum number of latched keys with a stored message
MB = 10**6


class RecorderOutput(ABC):
    """Output of messages to files; each method raises SourceError if a file cannot be written.

    Args:
        path: NAME.mcap.
        open_file: Opens a file.
    """

    def __init__(self, path: Path, open_file: Open) -> None:
        self._path, self._open = path, open_file
        self._writer: RecordingWriter | None = None
        self._latched: dict[str, Message] = {}  # last message by latched key
        self._count = 0  # number of files so far

    @abstractmethod
    def write(self, message: Message, log_time_ns: int) -> None:
        """Write a message at its time of reception."""

    def close(self) -> None:
        """Finish the open file."""
        if self._writer:
            self._writer.close()
            self._writer = None

    def summary(self) -> str:
        """Return a message on omitted messages; empty if there are none."""
        return ""

    def _store_latched(self, message: Message) -> bool:
        """Store a message; return False if its topic is not latched."""
        topic = BY_MESSAGE[type(message)]
        if topic.delivery != "latched":
            return False
        key = topic.key_of(message, "robot")
        if key in self._latched or len(self._latched) < KEYS_MAX:
            self._latched[key] = message
        return True

    def _open_next(self, log_time_ns: int) -> RecordingWriter:
        """Open the next numbered file; it begins with the latched messages."""
        self._count += 1
        writer = self._open(part_path(self._path, self._count))
        for message in self._latched.values():
            writer.write(message, log_time_ns)
        return writer


class SingleFile(RecorderOutput):
    """Output of all messages to one file."""

    def __init__(self, path: Path, open_file: Open) -> None:
        super().__init__(path, open_file)
        self._file = open_file(path)
        self._writer = self._file

    def write(self, message: Message, log_time_ns: int) -> None:
        """Append a message."""
        self._file.write(message, log_time_ns)


class RotatingParts(RecorderOutput):
    """Output to parts; the oldest are deleted beyond a limit.

    Args:
        path: NAME.mcap.
        limit_mb: [MB] approximate size of all parts together.
        open_file: Opens a part.
    """

    def __init__(self, path: Path, limit_mb: float, open_file: Open) -> None:
        super().__init__(path, open_file)
        self._part_bytes = limit_mb * MB / PARTS

    def write(self, message: Message, log_time_ns: int) -> None:
        """Append a message, in a new part if the current one is full."""
        if self._writer and self._writer.size_bytes >= self._part_bytes:
            self.close()
        if self._writer is None:
            if self._count >= PARTS:
                part_path(self._path, self._count - PARTS + 1).unlink(missing_ok=True)
            self._writer = self._open_next(log_time_ns)
        self._store_latched(message)
        self._writer.write(message, log_time_ns)

    def summary(self) -> str:
        """Return the number of deleted parts."""
        deleted = max(self._count - PARTS, 0)
        return f"{deleted} of {self._count} parts were deleted to stay within the limit."


class BufferedMessage(NamedTuple):
    """A message that waits for an event."""

    message: Message
    log_time_ns: int
    size: int  # [bytes] encoded


class EventFiles(RecorderOutput):
    """Output to a file for each event, with some seconds before and after it.

    Waiting messages are also bounded in bytes: the oldest are dropped and counted.

    Args:
        path: NAME.mcap.
        seconds: Time before the first event and after the last one of a file [s].
        condition: Condition on messages that are events.
        buffer_mb: Maximum memory of waiting messages [MB].
        open_file: Opens a file.
    """

    def __init__(
        self, path: Path, seconds: float, condition: Condition, buffer_mb: float, open_file: Open
    ) -> None:
        super().__init__(path, open_file)
        self._condition = condition
        self._span_ns, self._buffer_bytes = round(seconds * 1e9), buffer_mb * MB
        self._waiting: deque[BufferedMessage] = deque()
        self._waiting_bytes = 0
        self._end_ns = 0
        self._left_out = 0

    def write(self, message: Message, log_time_ns: int) -> None:
        """Write a message to the file of an event, else to memory."""
        latched = self._store_latched(message)
        if self._writer and log_time_ns > self._end_ns:
            self.close()
        if self._condition.is_met(message):
            self._end_ns = log_time_ns + self._span_ns
            self._writer = self._writer or self._next_file(log_time_ns)
        if self._writer:
            self._writer.write(message, log_time_ns)
        elif not latched:
            self._buffer(message, log_time_ns)

    def summary(self) -> str:
        """Return the number of events, and of messages dropped for lack of memory."""
        files = f"{self._count} file{'s' if self._count != 1 else ''} of events"
        if self._left_out:
            return f"{files}; {self._left_out} messages before them exceeded the buffer."
        return f"{files}."

    def _next_file(self, log_time_ns: int) -> RecordingWriter:
        writer = self._open_next(self._waiting[0].log_time_ns if self._waiting else log_time_ns)
        for one in self._waiting:
            writer.write(one.message, one.log_time_ns)
        self._waiting.clear()
        self._waiting_bytes = 0
        return writer

    def _buffer(self, message: Message, log_time_ns: int) -> None:
        if isinstance(message, RgbdFrame):
            message = compress(message)
        size = len(encode(message))
        self._waiting.append(BufferedMessage(message, log_time_ns, size))
        self._waiting_bytes += size
        while self._waiting and self._waiting[0].log_time_ns < log_time_ns - self._span_ns:
            self._waiting_bytes -= self._waiting.popleft().size
        while self._waiting and self._waiting_bytes > self._buffer_bytes:
            self._waiting_bytes -= self._waiting.popleft().size
            self._left_out += 1


def part_path(path: Path, number: int) -> Path:
    """Return the path of a numbered file next to NAME.mcap: NAME-0001.mcap."""
    return path.with_name(f"{path.stem}-{number:04d}{path.suffix}")
