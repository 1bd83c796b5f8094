"""Journal of events in a file; each event is written before its publication."""

import sqlite3
from collections.abc import Sequence
from pathlib import Path

from people4d.codec import decode, encode
from people4d.errors import ConfigError, DecodeError
from people4d.messages import Event

JOURNAL = "events.sqlite"  # name of the file in the state folder
TABLES = """
create table if not exists events (number integer primary key, message blob not null);
create table if not exists marks (name text primary key, number integer not null);
"""
PRUNE_EVERY = 500  # number of events between two deletions of old ones


class Journal:
    """Events of a robot, ordered by number.

    Args:
        file: SQLite file; None: in memory.
        most: Maximum number of events; the oldest are deleted.

    Raises:
        ConfigError: The file cannot be used.
    """

    def __init__(self, file: Path | None, most: int) -> None:
        self._most = most
        try:
            if file:
                file.parent.mkdir(parents=True, exist_ok=True)
            self._base = sqlite3.connect(file or ":memory:", check_same_thread=False, timeout=5)
            self._base.execute("pragma journal_mode=wal")
            self._base.execute("pragma synchronous=normal")
            self._base.executescript(TABLES)
            self._check()
        # SQLite quotes names of a damaged file that are not UTF-8.
        except (sqlite3.Error, OSError, UnicodeDecodeError) as error:
            raise ConfigError(
                f"the journal of events {file} cannot be used: {error}", "Move the file away."
            ) from error

    def append(self, events: Sequence[Event]) -> None:
        """Write events in one transaction; sqlite3.Error if that fails."""
        with self._base:
            rows = [(event.sequence, encode(event)) for event in events]
            self._base.executemany("insert into events values (?, ?)", rows)
            if any(event.sequence % PRUNE_EVERY == 0 for event in events):
                oldest = events[-1].sequence - self._most
                self._base.execute("delete from events where number <= ?", (oldest,))

    def after(self, number: int, most: int = -1) -> list[Event]:
        """Return the undamaged events above a number, oldest first."""
        query = "select message from events where number > ? order by number limit ?"
        found = []
        for (payload,) in self._base.execute(query, (number, most)):
            try:
                event = decode(payload) if isinstance(payload, bytes) else None
            except DecodeError:
                continue
            if isinstance(event, Event):
                found.append(event)
        return found

    def last_number(self) -> int:
        """Return the highest number; -1 without events."""
        (number,) = self._base.execute("select max(number) from events").fetchone()
        return -1 if number is None else int(number)

    def mark(self, name: str) -> int:
        """Return the number of the last event that a receiver has accepted; -1 if none."""
        row = self._base.execute("select number from marks where name = ?", (name,)).fetchone()
        return -1 if row is None else int(row[0])

    def set_mark(self, name: str, number: int) -> None:
        """Set the mark of a receiver; sqlite3.Error if that fails."""
        with self._base:
            self._base.execute("insert or replace into marks values (?, ?)", (name, number))

    def close(self) -> None:
        """Close the file."""
        self._base.close()

    def _check(self) -> None:
        """Check the whole file; sqlite3.Error if it is damaged or holds other tables."""
        columns = (
            ("events", "number integer, message blob"),
            ("marks", "name text, number integer"),
        )
        for table, expected in columns:
            rows = self._base.execute("select name, type from pragma_table_info(?)", (table,))
            found = ", ".join(f"{name} {kind}".lower() for name, kind in rows)
            if found != expected:
                raise sqlite3.DatabaseError(
                    f"expected a table {table} of {expected}, got {found:.80}"
                )
        (result,) = self._base.execute("pragma integrity_check(1)").fetchone()
        if result != "ok":
            raise sqlite3.DatabaseError(" ".join(f"{result:.200}".split()))
