"""Enrolled people: embeddings by name, in a private file, until they expire."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from common.io.files import read_bytes, write_private
from common.io.packed import pack, unpack
from people4d.errors import DecodeError
from people4d.messages import F64

FILE = "enrolled.target"  # name of the file in the state folder
FILE_MAX_BYTES = 2**24
PEOPLE_MAX = 64  # maximum number of enrolled people
DAY_NS = 86_400_000_000_000
UNIT_ERROR = 1e-3  # maximum deviation of the length of a view from 1
OFF = "enrolment is off: set target.enrolment_days, see docs/operation/enrolment.md"

T = TypeVar("T")


class Enrolled(msgspec.Struct):
    """Views of one person."""

    embedder: tuple[str, int]  # name and length of the embeddings
    views: list[F64]
    expires_ns: int  # [ns] wall time


class EnrolledFile(msgspec.Struct):
    """Content of the file."""

    people: dict[str, Enrolled] = {}


class Enrolment:
    """Enrolled people; the file is read for each use, and expired people are deleted from it.

    Args:
        file: File of the people; None: enrolment is off, and no file exists.
        days: Time until a person expires [days]; 0: people can only be forgotten.
        wall_ns: Clock of the expiry.

    Attributes:
        problem: Reason why the file cannot be used, with the remedy; empty if it can.
    """

    def __init__(
        self, file: Path | None, days: float, wall_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._file, self._days, self._wall_ns = file, days, wall_ns
        self.problem = ""
        self._use(self._read)

    def enrol(self, name: str, embedder: tuple[str, int], views: list[F64]) -> str:
        """Store views; return the reason if that fails."""
        if not self._days:
            return OFF
        expires_ns = self._wall_ns() + int(self._days * DAY_NS)
        people = self._use(self._read)
        if people is None:
            return self.problem
        if len(people) >= PEOPLE_MAX and name not in people:
            return f"{PEOPLE_MAX} people are enrolled: forget one first"
        self._use(lambda: self._write(people | {name: Enrolled(embedder, views, expires_ns)}))
        return self.problem

    def forget(self, name: str) -> str:
        """Delete a person; return the reason if that fails."""
        people = self._use(self._read)
        if people is None:
            return self.problem
        if people.pop(name, None) is None:
            return f"{name} is not enrolled"
        self._use(lambda: self._write(people))
        return self.problem

    def find(self, name: str) -> tuple[Enrolled | None, str]:
        """Return a person, or None and the reason."""
        if not self._days:
            return None, OFF
        people = self._use(self._read)
        if people is None:
            return None, self.problem
        found = people.get(name)
        return found, "" if found else f"{name} is not enrolled"

    def _use(self, action: Callable[[], T]) -> T | None:
        """Read or write the file; None and `problem` if that fails."""
        self.problem = ""
        try:
            return action()
        except DecodeError:
            self.problem = f"{self._file} is damaged: delete it, and enrol its people again"
        except OSError as error:
            self.problem = f"{self._file}: {error.strerror or error}"
        return None

    def _read(self) -> dict[str, Enrolled]:
        """Return the people; delete expired ones. DecodeError if the file is damaged."""
        if self._file is None or not self._file.exists():
            return {}
        people = unpack(read_bytes(self._file, FILE_MAX_BYTES), EnrolledFile).people
        for name, one in people.items():
            if not one.views or not all(_is_view(v, one.embedder[1]) for v in one.views):
                raise DecodeError(f"{name}: expected unit vectors of length {one.embedder[1]}")
        now_ns = self._wall_ns()
        valid = {name: one for name, one in people.items() if one.expires_ns > now_ns}
        if len(valid) < len(people):
            self._write(valid)
        return valid

    def _write(self, people: dict[str, Enrolled]) -> None:
        """Replace the file; delete it without people."""
        if self._file is None:
            return
        if people:
            write_private(self._file, pack(EnrolledFile(people)))
        else:
            self._file.unlink(missing_ok=True)


def _is_view(view: F64, length: int) -> bool:
    """Check that a view is a unit vector."""
    return view.shape == (length,) and abs(float(np.linalg.norm(view)) - 1.0) <= UNIT_ERROR
