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
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from common.runtime.heartbeat import Work
from common.runtime.node import StatefulNode
from people4d.errors import DecodeError

FOLDER = "PEOPLE4D_KEEP"  # environment variable; without it nothing is kept
SUFFIX = ".kept"
NUMBER = re.compile(rb"\d{15}")
HEADER = struct.Struct("<IQQ")  # checksum, which one it is, length
PERIOD_NS = 250_000_000
PAUSES = 50  # after having kept a state, so many times the time that it took are left to the node

log = logging.getLogger("people4d")


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


class Checkpoint:
    """Saves the state of a node while it runs; made, it restores what another process saved.

    A number is saved before anything is published that holds it, the state four times a second.

    Args:
        node: The node.
        store: Files of the state.
        work: Takes as its problem that the state cannot be saved.
    """

    def __init__(self, node: StatefulNode, store: Keeper, work: Work) -> None:
        self._node, self._store, self._work = node, store, work
        self._changed = False
        self._due_ns = 0
        self._number = 0
        saved = store.read()
        try:
            node.restore(saved.state, saved.next_number)
        except DecodeError as error:
            log.warning("%s: it begins anew", error)
        self.save_number()

    def save_number(self) -> None:
        """Save the next number if it has changed."""
        number = self._node.next_number()
        if number != self._number:
            self._number = number
            self._write(lambda: self._store.write_number(number))

    def handled(self) -> None:
        """Note that the node handled a message."""
        self.save_number()
        self._changed = True

    def ticked(self, now_ns: int, has_outputs: bool) -> None:
        """Save the number, and the state if that is due.

        Args:
            now_ns: Monotonic time in nanoseconds.
            has_outputs: Outputs wait to be published: they go first, unless there are some always.
        """
        self.save_number()
        if self._changed and now_ns >= self._due_ns + (PERIOD_NS if has_outputs else 0):
            start_ns = time.monotonic_ns()
            self.save_state()
            took_ns = time.monotonic_ns() - start_ns
            self._due_ns = now_ns + max(PERIOD_NS, PAUSES * took_ns)

    def save_state(self) -> None:
        """Save the state, if there is one yet."""
        self._changed = False
        state = self._node.save()
        if state:
            self._write(lambda: self._store.write_state(state))

    def _write(self, write: Callable[[], None]) -> None:
        try:
            write()
            self._work.problem = ""
        except OSError as error:
            where = f"{self._store.folder} ({error.strerror})"
            self._work.problem = f"its state cannot be saved in {where}: a restart loses it"


def _read(file: Path) -> bytes | None:
    """Return the content of a file; empty if it cannot be read, None if there is none."""
    try:
        return file.read_bytes()
    except FileNotFoundError:
        return None
    except OSError:
        return b""
