"""What a node knows, kept in a file, from which the next process of its name goes on.

Only the end of a process is provided for, not that of the machine: nothing is forced onto the disk.
"""

import errno
import logging
import os
import re
import struct
import time
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import msgspec

from common.runtime.node import Node, Status
from people4d.errors import DecodeError
from people4d.messages import Message

FOLDER = "PEOPLE4D_KEEP"  # environment variable; without it nothing is kept
SUFFIX = ".kept"
NUMBER = re.compile(rb"\d{15}")
HEADER = struct.Struct("<IQQ")  # checksum, which one it is, length
PERIOD_NS = 250_000_000
PAUSES = 50  # after having kept a state, so many times the time that it took are left to the node

log = logging.getLogger("people4d")


@runtime_checkable
class Lasting(Protocol):
    """What a node has whose state outlives its process."""

    def next_number(self) -> int:
        """Return the next number to be given, for example to a person; none is given twice."""
        ...

    def save(self) -> bytes:
        """Return what the node knows; empty if nothing yet."""
        ...

    def restore(self, saved: bytes, next_number: int) -> None:
        """Go on with what another process saved.

        Args:
            saved: From `save`; empty if it is lost.
            next_number: All below it are taken as given.

        Raises:
            DecodeError: `saved` is damaged; only the number was taken then.
        """
        ...


@dataclass(frozen=True)
class Kept:
    """What a file said.

    Args:
        state: Empty if there was none.
        next_number: 0 if nothing was kept.
    """

    state: bytes
    next_number: int


class Keeper:
    """The files of one process: the next number it gives, and its state in two places by turns.

    Whoever is killed while writing leaves the other place whole. Files are written in place,
    because to put a new one in place of an old one waits for the disk, 4 ms on ext4.

    Args:
        folder: Made if it does not exist.
        instance: Name of the process.
    """

    def __init__(self, folder: Path, instance: str) -> None:
        self.folder = folder
        self._number = folder / f"{instance}.next{SUFFIX}"
        self._places = [folder / f"{instance}.state{place}{SUFFIX}" for place in (0, 1)]
        self._count = 0  # of states written

    def read(self) -> Kept:
        """Return what was kept; where the number is lost, one that cannot have been given yet."""
        number, places = _read(self._number), [_read(place) for place in self._places]
        states = [found for place in places if place and (found := _opened(place))]
        self._count, state = max(states, default=(0, b""))
        if number and NUMBER.fullmatch(number):
            return Kept(state, int(number))
        if number is None and all(place is None for place in places):
            return Kept(b"", 0)
        # People do not come at one a second for years, so the time in seconds is above all numbers.
        return Kept(state, int(time.time()))

    def write_number(self, number: int) -> None:
        """Keep the next number; OSError if that fails."""
        self._write(self._number, b"%015d" % number)

    def write_state(self, state: bytes) -> None:
        """Keep a state; OSError if that fails."""
        self._count += 1
        self._write(self._places[self._count % 2], _closed(self._count, state))

    def _write(self, file: Path, content: bytes) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT, 0o600)
        try:
            if os.pwrite(descriptor, content, 0) < len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        finally:
            os.close(descriptor)


def _closed(count: int, state: bytes) -> bytes:
    """Return a state with what shows that it is whole, and the newest."""
    return HEADER.pack(zlib.crc32(state), count, len(state)) + state


def _opened(content: bytes) -> tuple[int, bytes] | None:
    """Return count and state of what `_closed` made, None if it is not whole."""
    if len(content) < HEADER.size:
        return None
    checksum, count, length = HEADER.unpack_from(content)
    state = content[HEADER.size : HEADER.size + length]
    return (count, state) if len(state) == length and zlib.crc32(state) == checksum else None


class KeptNode:
    """A node whose state is kept; all else is its own.

    A number is kept before anything is published that tells it, the state four times a second.

    Args:
        node: The node, which must be `Lasting`.
        keeper: Where its state is kept.
    """

    inputs: ClassVar[tuple[type[Message], ...]]

    def __init__(self, node: Any, keeper: Keeper) -> None:
        self._node = node
        self._keeper = keeper
        self._problem = ""
        self._changed = False
        self._due_ns = 0
        kept = keeper.read()
        try:
            node.restore(kept.state, kept.next_number)
        except DecodeError as error:
            log.warning("%s: it begins anew", error)
        self._told = 0
        self._keep_number()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._node, name)

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Let the node answer; what it numbers is kept first."""
        outputs: Sequence[Message] = self._node.handle(message, now_ns)
        self._keep_number()
        self._changed = True
        return outputs

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return what is due, and keep the state."""
        outputs: Sequence[Message] = self._node.tick(now_ns)
        self._keep_number()
        # What is due goes out first, unless something always is.
        due_ns = self._due_ns + (PERIOD_NS if outputs else 0)
        if self._changed and now_ns >= due_ns:
            start_ns = time.monotonic_ns()
            self._keep_state()
            took_ns = time.monotonic_ns() - start_ns
            self._due_ns = now_ns + max(PERIOD_NS, PAUSES * took_ns)
        return outputs

    def flush(self, now_ns: int) -> Sequence[Message]:
        """Return what the node held back, if it can tell."""
        flush = getattr(self._node, "flush", None)
        outputs: Sequence[Message] = flush(now_ns) if flush else ()
        self._keep_number()
        return outputs

    def wake_ns(self) -> int | None:
        """Return when the node wants a tick."""
        wake_ns: int | None = self._node.wake_ns()
        return wake_ns

    def status(self) -> Status:
        """Return the node's status, and that its state cannot be kept."""
        status: Status = self._node.status()
        if not self._problem or status.state not in ("ready", "degraded"):
            return status
        reason = "; ".join(filter(None, (status.reason, self._problem)))
        return msgspec.structs.replace(status, state="degraded", reason=reason)

    def close(self) -> None:
        """Keep the last state and close the node."""
        self._keep_state()
        self._node.close()

    def _keep_number(self) -> None:
        number = self._node.next_number()
        if number != self._told:
            self._told = number
            self._try(lambda: self._keeper.write_number(number))

    def _keep_state(self) -> None:
        self._changed = False
        state = self._node.save()
        if state:
            self._try(lambda: self._keeper.write_state(state))

    def _try(self, write: Any) -> None:
        try:
            write()
            self._problem = ""
        except OSError as error:
            folder, why = self._keeper.folder, error.strerror
            self._problem = f"its state cannot be kept in {folder} ({why}): a restart loses it"


def keep(node: Node, instance: str, environment: Mapping[str, str] = os.environ) -> Node:
    """Return a node that goes on where the process of that name before it ended, if it can.

    Args:
        node: The node.
        instance: Name of the process.
        environment: Environment variables; PEOPLE4D_KEEP names the folder.
    """
    folder = environment.get(FOLDER)
    if not folder or not isinstance(node, Lasting):
        return node
    return KeptNode(node, Keeper(Path(folder), instance))


def _read(file: Path) -> bytes | None:
    """Return the content of a file; empty if it cannot be read, None if there is none."""
    try:
        return file.read_bytes()
    except FileNotFoundError:
        return None
    except OSError:
        return b""
