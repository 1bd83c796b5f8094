"""Enrolled people: embeddings by name, in a private file, until they expire."""

import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from common.io.files import read_bytes, write_private
from common.io.packed import pack, unpack
from people4d.errors import ConfigError, DecodeError
from people4d.messages import F64

FILE = "enrolled.target"  # name of the file in the state folder
FILE_MAX_BYTES = 2**24
PEOPLE_MAX = 64  # maximum number of enrolled people
DAY_NS = 86_400_000_000_000
OFF = "enrolment is off: set target.enrolment_days, see docs/operation/enrolment.md"


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

    Raises:
        ConfigError: The file cannot be read, or is damaged.
    """

    def __init__(
        self, file: Path | None, days: float, wall_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._file, self._days, self._wall_ns = file, days, wall_ns
        try:
            self._read()
        except (OSError, DecodeError) as error:
            raise ConfigError(
                f"{file}: {error}", "Delete the file, and enrol its people again."
            ) from error

    def enrol(self, name: str, embedder: tuple[str, int], views: list[F64]) -> str:
        """Store views; return the reason if that fails."""
        if not self._days:
            return OFF
        expires_ns = self._wall_ns() + int(self._days * DAY_NS)
        try:
            people = self._read()
            if len(people) >= PEOPLE_MAX and name not in people:
                return f"{PEOPLE_MAX} people are enrolled: forget one first"
            self._write(people | {name: Enrolled(embedder, views, expires_ns)})
        except (OSError, DecodeError) as error:
            return f"the file of enrolled people: {error}"
        return ""

    def forget(self, name: str) -> str:
        """Delete a person; return the reason if that fails."""
        try:
            people = self._read()
            if people.pop(name, None) is None:
                return f"{name} is not enrolled"
            self._write(people)
        except (OSError, DecodeError) as error:
            return f"the file of enrolled people: {error}"
        return ""

    def find(self, name: str) -> tuple[Enrolled | None, str]:
        """Return a person, or None and the reason."""
        if not self._days:
            return None, OFF
        try:
            found = self._read().get(name)
        except (OSError, DecodeError) as error:
            return None, f"the file of enrolled people: {error}"
        return found, "" if found else f"{name} is not enrolled"

    def _read(self) -> dict[str, Enrolled]:
        """Return the people; delete expired ones."""
        if self._file is None or not self._file.exists():
            return {}
        people = unpack(read_bytes(self._file, FILE_MAX_BYTES), EnrolledFile).people
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
