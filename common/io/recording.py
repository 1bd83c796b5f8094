"""Recordings: MCAP files of messages in their wire format.

The profile is "people4d"; a channel's topic is its key below people4d/v1/<robot>/, so a recording
replays under any robot's name. Messages are uncompressed (colour is JPEG, depth is PNG) and
separate records, so a crash loses at most the last one.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, Self

import msgspec
from mcap.writer import CompressionType, IndexType, Writer

from common.io.images import compress
from common.io.mcap_index import McapIndex, MessageEntry, scan
from people4d.codec import MAX_BYTES, decode, encode
from people4d.errors import DecodeError, SourceError
from people4d.messages import Message, RgbdFrame
from people4d.topics import BY_MESSAGE, prefix, topic_of_key

PROFILE = "people4d"
ENCODING = "msgpack"


class RecordingWriter:
    """Writes messages to a file; use it in a `with` block.

    Each method raises SourceError if the file cannot be written, for example because the disk is
    full; the messages before remain.

    Args:
        path: The file; its folder is created, an existing file is replaced.
        quality: JPEG quality of frames that arrive uncompressed, 1 to 100.
    """

    def __init__(self, path: Path, quality: int = 90) -> None:
        self._path = path
        self._quality = quality
        self._channels: dict[str, int] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file: BinaryIO = path.open("wb")
        except OSError as error:
            raise SourceError(f"recording {path} cannot be written: {error.strerror}") from error
        self._writer = Writer(
            self._file,
            compression=CompressionType.NONE,
            index_types=IndexType.NONE,
            use_chunking=False,
        )
        self._writer.start(PROFILE, "people4d")

    def write(self, message: Message, log_time_ns: int) -> None:
        """Append a message at its time of reception; an uncompressed frame is compressed first."""
        if isinstance(message, RgbdFrame):
            message = compress(message, self._quality)
        with self._source_errors():
            self._writer.add_message(
                self._channel(message),
                log_time=max(log_time_ns, 0),
                data=encode(message),
                publish_time=max(message.stamp_ns, 0),
                sequence=message.sequence & 0xFFFFFFFF,
            )

    def write_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record, preferably before all messages; it replaces an earlier one."""
        with self._source_errors():
            self._writer.add_metadata(name, dict(values))

    @property
    def size_bytes(self) -> int:
        """Size of the file so far [bytes]."""
        return 0 if self._file.closed else self._file.tell()

    def close(self) -> None:
        """Finish and close the file; does nothing after it could not be written."""
        if not self._file.closed:
            with self._source_errors():
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._file.close()

    @contextmanager
    def _source_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            with suppress(OSError):  # closed even if the rest cannot be written
                self._file.close()
            raise SourceError(
                f"recording {self._path} cannot be written: {error.strerror}",
                "The messages before it can be read.",
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _channel(self, message: Message) -> int:
        key = BY_MESSAGE[type(message)].key_of(message, "robot")
        topic = key.removeprefix(prefix("robot") + "/")
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, ENCODING, schema_id=0)
        return self._channels[topic]


class RecordingSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Contents of a recording."""

    topics: dict[str, int]  # number of messages by topic, sorted by topic
    # Encoding of messages by topic, "msgpack" unless another program reads it
    encodings: dict[str, str]
    start_ns: int  # [ns] log time of the first message; 0 if there is none
    duration_s: float  # [s] time from the first to the last message
    # True if the file is cut short or damaged; messages before the damage are readable
    truncated: bool


class Recording:
    """A recording opened for reading, see `open_recording`."""

    def __init__(self, path: Path, index: McapIndex) -> None:
        self._path = path
        self._index = index
        # Number of messages skipped by `messages` since they could not be decoded
        self.bad_messages = 0

    @property
    def summary(self) -> RecordingSummary:
        """Contents of the recording, without decoding any message."""
        entries = self._index.entries
        start_ns, end_ns = (entries[k].log_time_ns if entries else 0 for k in (0, -1))
        return RecordingSummary(
            topics=dict(sorted(Counter(entry.topic for entry in entries).items())),
            encodings=dict(self._index.encodings),
            start_ns=start_ns,
            duration_s=(end_ns - start_ns) / 1e9,
            truncated=self._index.truncated,
        )

    @property
    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Metadata records by name."""
        return self._index.metadata

    def messages(
        self, *types: type[Message], start_s: float = 0.0, end_s: float = math.inf
    ) -> Iterator[tuple[int, Message]]:
        """Iterate over messages in the order of their log time.

        SourceError if the file was deleted after it was opened.

        Args:
            types: Requested types; all if none is given. Frames are CompressedRgbdFrame.
            start_s: Start [s], from the first message of the recording. The last earlier message of
                each latched topic is first, at the log time of the start.
            end_s: End [s], from the first message of the recording.

        Yields:
            Log time in nanoseconds and the message. Messages that cannot be decoded are skipped
            and counted in `bad_messages`; topics in other encodings are ignored.
        """
        topics = {topic for topic in self._index.topics.values() if self._holds(topic, types)}
        wanted = [entry for entry in self._index.entries if entry.topic in topics]
        first_ns = self._index.entries[0].log_time_ns if self._index.entries else 0
        begin_ns = first_ns + round(start_s * 1e9)
        latched = {e.topic: e for e in wanted if e.log_time_ns < begin_ns and _is_latched(e.topic)}
        wanted = [*latched.values(), *(e for e in wanted if e.log_time_ns >= begin_ns)]
        try:
            with self._path.open("rb") as file:
                for entry in wanted:
                    if (entry.log_time_ns - first_ns) / 1e9 > end_s:
                        break
                    message = _read(file, entry)
                    if message is None or (types and not isinstance(message, types)):
                        self.bad_messages += 1
                    else:
                        yield max(entry.log_time_ns, begin_ns), message
        except OSError as error:
            raise SourceError(f"recording {self._path} cannot be read: {error.strerror}") from error

    def _holds(self, topic: str, types: tuple[type[Message], ...]) -> bool:
        if self._index.encodings[topic] not in ("", ENCODING):
            return False
        known = topic_of_key(f"{prefix('robot')}/{topic}")
        return not types or (known is not None and known.message in types)


def open_recording(path: Path) -> Recording:
    """Open a recording, up to its last complete message; SourceError for another file."""
    try:
        with path.open("rb") as file:
            index = scan(file)
    except OSError as error:
        raise SourceError(
            f"recording {path} cannot be read: {error.strerror}", "Check the path."
        ) from error
    except DecodeError as error:
        raise SourceError(f"{path} is not a recording: {error.problem}", error.hint) from error
    if index.profile != PROFILE:
        raise SourceError(
            f"{path} is an MCAP file of profile {index.profile[:40]!r}, not of {PROFILE!r}",
            "Open a ROS 2 recording as a ROS bag.",
        )
    return Recording(path, index)


def _is_latched(topic: str) -> bool:
    known = topic_of_key(f"{prefix('robot')}/{topic}")
    return known is not None and known.delivery == "latched"


def _read(file: BinaryIO, entry: MessageEntry) -> Message | None:
    if entry.size > MAX_BYTES:
        return None
    file.seek(entry.offset)
    try:
        return decode(file.read(entry.size))
    except DecodeError:
        return None
