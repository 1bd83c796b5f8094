"""Index of an MCAP file, built from the front so that a truncated file works too."""

import struct
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata

from people4d.errors import DecodeError, SourceError

MAGIC = b"\x89MCAP0\r\n"
MAX_HEADER_BYTES = 2**20  # maximum size of a header, channel or metadata record
MAX_DESCRIPTION_BYTES = 16 * 2**20  # maximum total size of headers, channels and metadata
# Maximum number of messages, a bound on the memory of the index: 90 hours at 30 Hz
MAX_MESSAGES = 10_000_000
MAX_CHANNELS = 4096
MAX_METADATA = 256

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQII")
_LENGTH = struct.Struct("<Q")
_OPCODES = frozenset({*Opcode, *range(0x80, 0x100)})  # opcodes of MCAP and of private extensions


@dataclass(frozen=True, slots=True)
class MessageEntry:
    """One message in the file."""

    log_time_ns: int
    topic: str
    offset: int  # [bytes] offset of the payload from the start of the file
    size: int  # [bytes] size of the payload


@dataclass
class McapIndex:
    """All messages of a file in the order of their log time."""

    profile: str = ""
    entries: list[MessageEntry] = field(default_factory=list)
    # True if the file is cut short or damaged; messages before the damage are indexed
    truncated: bool = False
    topics: dict[int, str] = field(default_factory=dict)  # topic by number of the channel
    encodings: dict[str, str] = field(default_factory=dict)  # encoding of messages by topic
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)  # metadata records by name
    # [bytes] total size of headers, channels and metadata records so far
    description_bytes: int = 0


def read_profile(path: Path) -> str:
    """Return the profile at the start of an MCAP file: "people4d", "ros2", empty if none.

    SourceError if the file cannot be read or is not an MCAP file.
    """
    try:
        with path.open("rb") as file:
            head = file.read(256)
    except OSError as error:
        raise SourceError(f"source {path} cannot be read: {error.strerror}") from error
    if not head.startswith(MAGIC) or len(head) < 21:
        raise SourceError(f"source {path} is not an MCAP file", "It may be truncated.")
    length = int.from_bytes(head[17:21], "little")  # after magic (8), opcode (1), length (8)
    return head[21 : 21 + length].decode("utf-8", "replace")


def scan(file: BinaryIO) -> McapIndex:
    """Index the messages of a file, up to the position where it is cut short or damaged.

    DecodeError if the file is no MCAP file, has compressed chunks, or exceeds a limit; OSError if
    reading failed.
    """
    if file.read(len(MAGIC)) != MAGIC:
        raise DecodeError("it has no MCAP signature", "Check the path.")
    end = file.seek(0, 2)
    index = McapIndex()
    position = len(MAGIC)
    try:
        while (step := _record(file, position, end, index)) is not None:
            position = step
    except (struct.error, McapError, UnicodeDecodeError):
        index.truncated = True  # a power failure can leave junk at the end
    if not index.profile and index.truncated:
        raise DecodeError("it is truncated before its header")
    index.entries.sort(key=lambda entry: entry.log_time_ns)
    return index


def _record(file: BinaryIO, position: int, end: int, index: McapIndex) -> int | None:
    """Index the record at a position; return the position of the next one, None at the end."""
    start = position + _RECORD.size
    file.seek(position)
    opcode: int
    size: int
    opcode, size = _RECORD.unpack(file.read(_RECORD.size))
    if opcode == Opcode.CHUNK and start + _CHUNK.size <= end:
        return _chunk(file, start, end)
    if start + size > end or opcode not in _OPCODES:
        index.truncated = True
        return None
    if opcode in (Opcode.HEADER, Opcode.CHANNEL, Opcode.METADATA):
        index.description_bytes += size
        if index.description_bytes > MAX_DESCRIPTION_BYTES:
            raise DecodeError(f"its metadata has more than {MAX_DESCRIPTION_BYTES} bytes")
        if size > MAX_HEADER_BYTES:
            raise DecodeError(
                f"it has a header or metadata of {size} bytes, more than {MAX_HEADER_BYTES}"
            )
        _describe(opcode, ReadDataStream(BytesIO(file.read(size))), index)
    elif opcode == Opcode.MESSAGE:
        _message(file, start, size, index)
    elif opcode in (Opcode.DATA_END, Opcode.FOOTER):
        return None
    return start + size


def _chunk(file: BinaryIO, start: int, end: int) -> int:
    """Return the position of the first record in a chunk."""
    *_, compression_size = _CHUNK.unpack(file.read(_CHUNK.size))
    if compression_size:
        raise DecodeError(
            "its chunks are compressed", "Rewrite it with `mcap compress --compression none`."
        )
    return min(start + _CHUNK.size + _LENGTH.size, end)


def _describe(opcode: int, record: ReadDataStream, index: McapIndex) -> None:
    if opcode == Opcode.HEADER:
        index.profile = Header.read(record).profile
    elif opcode == Opcode.METADATA:
        metadata = Metadata.read(record)
        index.metadata[metadata.name] = metadata.metadata
    else:
        channel = Channel.read(record)
        index.topics[channel.id] = channel.topic
        index.encodings[channel.topic] = channel.message_encoding
    if len(index.metadata) > MAX_METADATA:
        raise DecodeError(f"it has more than {MAX_METADATA} metadata records")
    if len(index.topics) > MAX_CHANNELS:
        raise DecodeError(f"it has more than {MAX_CHANNELS} channels")


def _message(file: BinaryIO, start: int, size: int, index: McapIndex) -> None:
    channel, _, log_time_ns, _ = _MESSAGE.unpack(file.read(min(size, _MESSAGE.size)))
    if channel not in index.topics:
        raise McapError(f"message of an unknown channel at byte {start}")
    offset = start + _MESSAGE.size
    index.entries.append(
        MessageEntry(log_time_ns, index.topics[channel], offset, size - _MESSAGE.size)
    )
    if len(index.entries) > MAX_MESSAGES:
        raise DecodeError(f"it has more than {MAX_MESSAGES} messages", "Split the recording.")
