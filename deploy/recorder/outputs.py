"""Outputs of the recorder: one file, parts with a limit of their size, files around events."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from common.io.images import compress
from common.io.recording import RecordingWriter
from deploy.recorder.conditions import Condition
from deploy.recorder.latched import LatchedMessages
from people4d.codec import encode
from people4d.messages import Message, RgbdFrame

Open = Callable[[Path], RecordingWriter]

PARTS = 10  # of the recording with a limit, so that the oldest tenth is deleted at once
MB = 10**6


class RecorderOutput(Protocol):
    """Destination of recorded messages."""

    def write(self, message: Message, log_time_ns: int) -> None:
        """Take a message; SourceError if its file cannot be written."""
        ...

    def close(self) -> None:
        """Finish the files."""
        ...

    def note(self) -> str:
        """Return a sentence on what was left out, empty if nothing was."""
        ...


class SingleFile:
    """Everything in one file."""

    def __init__(self, path: Path, open_file: Open) -> None:
        self._writer = open_file(path)

    def write(self, message: Message, log_time_ns: int) -> None:
        """Append a message."""
        self._writer.write(message, log_time_ns)

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()

    def note(self) -> str:
        """Return nothing: all is in the file."""
        return ""


class RotatingParts:
    """Parts NAME-0001.mcap and on, of which the oldest are deleted beyond a limit.

    Every part begins with the latched messages, so that each can be played alone.

    Args:
        path: NAME.mcap.
        limit_mb: [MB] of all parts together, about.
        open_file: Opens a part.
    """

    def __init__(self, path: Path, limit_mb: float, open_file: Open) -> None:
        self._path, self._open = path, open_file
        self._part_bytes = limit_mb * MB / PARTS
        self._latched = LatchedMessages()
        self._parts: deque[Path] = deque()
        self._writer: RecordingWriter | None = None
        self._count = 0

    def write(self, message: Message, log_time_ns: int) -> None:
        """Append a message, in a new part if the present one is full."""
        self._latched.add(message)
        if self._writer and self._writer.size_bytes >= self._part_bytes:
            self._writer.close()
            self._writer = None
        if self._writer is None:
            self._writer = self._next_part()
            for latched in self._latched.messages():
                if latched is not message:
                    self._writer.write(latched, log_time_ns)
        self._writer.write(message, log_time_ns)

    def close(self) -> None:
        """Finish the part that is written."""
        if self._writer:
            self._writer.close()

    def note(self) -> str:
        """Return the number of deleted parts."""
        deleted = self._count - len(self._parts)
        return f"{deleted} of {self._count} parts were deleted to stay within the limit."

    def _next_part(self) -> RecordingWriter:
        while len(self._parts) >= PARTS:
            self._parts.popleft().unlink(missing_ok=True)
        self._count += 1
        path = part_path(self._path, self._count)
        self._parts.append(path)
        return self._open(path)


@dataclass(frozen=True, slots=True)
class BufferedMessage:
    """A message that waits for an event."""

    message: Message
    log_time_ns: int
    size: int  # [bytes] encoded


class EventFiles:
    """A file NAME-0001.mcap for each event, from some seconds before it to some after the last.

    What waits is bounded in bytes as well: beyond, the oldest messages are left out and counted.

    Args:
        path: NAME.mcap.
        seconds: [s] before the event, and after the last one of a file.
        condition: Is met by the message that is an event.
        buffer_mb: [MB] of memory for messages that wait.
        open_file: Opens a file.
    """

    def __init__(
        self, path: Path, seconds: float, condition: Condition, buffer_mb: float, open_file: Open
    ) -> None:
        self._path, self._open, self._condition = path, open_file, condition
        self._span_ns, self._buffer_bytes = round(seconds * 1e9), buffer_mb * MB
        self._latched = LatchedMessages()
        self._waiting: deque[BufferedMessage] = deque()
        self._waiting_bytes = 0
        self._writer: RecordingWriter | None = None
        self._end_ns = 0
        self._count = self._left_out = 0

    def write(self, message: Message, log_time_ns: int) -> None:
        """Take a message: into the file of an event, else into memory."""
        latched = self._latched.add(message)
        if self._writer and log_time_ns > self._end_ns:
            self._writer.close()
            self._writer = None
        if self._condition.is_met(message):
            self._end_ns = log_time_ns + self._span_ns
            self._writer = self._writer or self._next_file(log_time_ns)
        if self._writer:
            self._writer.write(message, log_time_ns)
        elif not latched:
            self._buffer(message, log_time_ns)

    def close(self) -> None:
        """Finish the file of the last event."""
        if self._writer:
            self._writer.close()

    def note(self) -> str:
        """Return the number of events, and of messages for which memory was too small."""
        files = f"{self._count} file{'s' if self._count != 1 else ''} of events"
        if self._left_out:
            return f"{files}; {self._left_out} messages before them exceeded the buffer."
        return f"{files}."

    def _next_file(self, log_time_ns: int) -> RecordingWriter:
        self._count += 1
        writer = self._open(part_path(self._path, self._count))
        start_ns = self._waiting[0].log_time_ns if self._waiting else log_time_ns
        for message in self._latched.messages():
            writer.write(message, start_ns)
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
    """Return the path of a numbered file beside NAME.mcap: NAME-0001.mcap."""
    return path.with_name(f"{path.stem}-{number:04d}{path.suffix}")
