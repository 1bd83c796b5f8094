"""Checkpoints: state of a node in files, restored by the next process of its name.

A checkpoint survives the end of a process, but not a power failure: files are not synced.
"""

import errno
import logging
import os
import re
import struct
import time
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from common.runtime.heartbeat import Activity
from common.runtime.node import StatefulNode
from people4d.errors import DecodeError

FOLDER = "PEOPLE4D_STATE"  # environment variable
SUFFIX = ".checkpoint"
NUMBER = re.compile(rb"\d{15}")
HEADER = struct.Struct("<IQQ")  # checksum, count of states written, length
PERIOD_NS = 250_000_000
PAUSES = 50  # minimum pause after a save, in durations of the save

log = logging.getLogger("people4d")


def state_folder(robot: str, environment: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of a robot's state: $PEOPLE4D_STATE/<robot>, else under $XDG_STATE_HOME."""
    home = environment.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(environment.get(FOLDER) or Path(home) / "people4d").absolute() / robot


@dataclass(frozen=True)
class SavedState:
    """Content of a checkpoint."""

    state: bytes  # stored state; empty if none was saved
    next_number: int  # next unused number; 0 if there is none


class CheckpointStore:
    """Files of one process: its next number, and its state in two files, written alternately.

    A process that is killed while it writes leaves the other file intact. Files are written in
    place, since replacing a file takes 4 ms on ext4.
    """

    def __init__(self, folder: Path, instance: str) -> None:
        self.folder = folder
        self._number_file = folder / f"{instance}.next{SUFFIX}"
        self._state_files = [folder / f"{instance}.state{i}{SUFFIX}" for i in (0, 1)]
        self._count = 0  # number of states written

    def read(self) -> SavedState:
        """Return the newest state; a lost number is replaced by an unused one."""
        number, contents = _read(self._number_file), [_read(file) for file in self._state_files]
        states = [found for content in contents if content and (found := _unpack(content))]
        self._count, state = max(states, default=(0, b""))
        if number and NUMBER.fullmatch(number):
            return SavedState(state, int(number))
        if number is None and all(content is None for content in contents):
            return SavedState(b"", 0)
        # The time in seconds exceeds all numbers, which grow by less than one per second.
        return SavedState(state, int(time.time()))

    def write_number(self, number: int) -> None:
        """Write the next number; OSError if that fails."""
        self._write(self._number_file, b"%015d" % number)

    def write_state(self, state: bytes) -> None:
        """Write a state; OSError if that fails."""
        self._count += 1
        header = HEADER.pack(zlib.crc32(state), self._count, len(state))
        self._write(self._state_files[self._count % 2], header + state)

    def _write(self, file: Path, content: bytes) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT, 0o600)
        try:
            if os.pwrite(descriptor, content, 0) < len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.ftruncate(descriptor, len(content))
        finally:
            os.close(descriptor)


class Checkpoint:
    """Saves the state of a node while it runs, and restores the state of its predecessor.

    A number is saved before it is published, the state four times a second.
    """

    def __init__(self, node: StatefulNode, store: CheckpointStore, activity: Activity) -> None:
        self._node, self._store, self._activity = node, store, activity
        self._problems: dict[str, str] = {}
        self._changed = False
        self._due_ns = 0
        self._number = 0
        saved = store.read()
        try:
            node.restore(saved.state, saved.next_number)
        except DecodeError as error:
            log.warning("%s: it starts empty", error)
        except Exception:  # undetected damage; a restart must not fail for ever
            log.exception("the saved state is damaged: it starts empty")
            node.restore(b"", saved.next_number)
        self.save_number()

    def save_number(self) -> None:
        """Save the next number if it has changed."""
        number = self._node.next_number()
        if number != self._number:
            self._number = number
            self._try("number", lambda: self._store.write_number(number))

    def handled(self) -> None:
        """Record that the node handled a message."""
        self.save_number()
        self._changed = True

    def ticked(self, now_ns: int, has_outputs: bool) -> None:
        """Save the number, and the state if that is due.

        Args:
            now_ns: Monotonic time in nanoseconds.
            has_outputs: True: outputs are published before the state is saved.
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
            self._try("state", lambda: self._store.write_state(state))

    def _try(self, what: str, write: Callable[[], None]) -> None:
        self._problems.pop(what, None)  # on a full disk a number may fit, but no state
        try:
            write()
        except OSError as error:
            where = f"{self._store.folder} ({error.strerror})"
            self._problems[what] = f"its state cannot be saved in {where}: a restart loses it"
        self._activity.problem = next(iter(self._problems.values()), "")


def _unpack(content: bytes) -> tuple[int, bytes] | None:
    """Return count and state of a state file, None if it is damaged."""
    if len(content) < HEADER.size:
        return None
    checksum, count, length = HEADER.unpack_from(content)
    state = content[HEADER.size : HEADER.size + length]
    return (count, state) if len(state) == length and zlib.crc32(state) == checksum else None


def _read(file: Path) -> bytes | None:
    """Return the content of a file; empty if it cannot be read, None if there is none."""
    try:
        return file.read_bytes()
    except FileNotFoundError:
        return None
    except OSError:
        return b""
