"""Truth from CSV with the columns of `people4d csv`."""

import csv
import math
from collections.abc import Iterator, Mapping
from itertools import groupby, islice
from pathlib import Path
from typing import TextIO, TypeAlias

import numpy as np

from common.io.people_table import NAMES
from people4d.codec import MAX_ITEMS
from people4d.errors import SourceError
from people4d.messages import F64, Truth, TruthPerson
from services.gt_bridge.config import GtBridgeConfig

NEEDED = ("stamp_ns", "id", "x_m", "y_m", "z_m")
Row: TypeAlias = Mapping[str, str]
MAX_LINE = 16384  # maximum length of a line [characters]
MAX_COLUMNS = 256


class CsvTruth:
    """Rows of kind truth, or all rows without a column `kind`; stamps must not fall.

    People without a position are left out. SourceError if the file cannot be read, or lacks a
    required column.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        self._path = Path(config.truth)
        if not any(True for _ in self._rows()):  # a wrong file fails at the start
            raise SourceError(f"truth {self._path} has no row of kind truth", "Check the file.")

    def __iter__(self) -> Iterator[Truth]:
        """Yield one message for each stamp; SourceError if a row is invalid."""
        last_ns = None
        for sequence, (stamp_ns, rows) in enumerate(groupby(self._rows(), key=self._stamp_ns)):
            people = list(islice(rows, MAX_ITEMS + 1))
            if len(people) > MAX_ITEMS:
                raise self._wrong(people[-1], f"more than {MAX_ITEMS} people of one stamp")
            if last_ns is not None and stamp_ns < last_ns:
                raise self._wrong(people[0], f"expected rising stamps, got {stamp_ns} again")
            last_ns = stamp_ns
            yield self._truth(stamp_ns, sequence, people)

    def _truth(self, stamp_ns: int, sequence: int, rows: list[Row]) -> Truth:
        try:
            return Truth(
                stamp_ns=stamp_ns,
                sequence=sequence,
                frame_id=rows[0].get("frame_id") or "map",
                people=tuple(person for person in map(_person, rows) if person is not None),
            )
        except ValueError as error:
            raise self._wrong(rows[0], str(error)) from error

    def _stamp_ns(self, row: Row) -> int:
        try:
            return int(row["stamp_ns"])
        except ValueError as error:
            raise self._wrong(row, f"expected stamp_ns, got {row['stamp_ns']!r:.40}") from error

    def _rows(self) -> Iterator[Row]:
        try:
            with self._path.open(newline="", encoding="utf-8-sig") as file:
                reader = csv.DictReader(_lines(file), restval="", restkey="")
                if len(reader.fieldnames or ()) > MAX_COLUMNS:
                    raise SourceError(f"truth {self._path} has more than {MAX_COLUMNS} columns")
                missing = [name for name in NEEDED if name not in (reader.fieldnames or ())]
                if missing:
                    raise SourceError(
                        f"truth {self._path} lacks the column {missing[0]}",
                        f"Needed are {', '.join(NEEDED)}; known are {', '.join(NAMES)}.",
                    )
                for row in reader:
                    row["line"] = str(reader.line_num)
                    if row.get("kind", "truth") == "truth":
                        yield row
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise SourceError(f"truth {self._path} cannot be read as CSV: {error}") from error

    def _wrong(self, row: Row, what: str) -> SourceError:
        return SourceError(f"truth {self._path}, line {row['line']}: {what}", "Correct the row.")


def _lines(file: TextIO) -> Iterator[str]:
    """Yield lines of limited length."""
    while line := file.readline(MAX_LINE):
        if len(line) == MAX_LINE:
            raise csv.Error(f"a line has {MAX_LINE} characters or more")
        yield line


def _person(row: Row) -> TruthPerson | None:
    """Return the person of a row, None if it has no position."""
    position = _vector(row, ("x_m", "y_m", "z_m"))
    if np.isnan(position).any():
        return None
    velocity = _vector(row, ("vx_mps", "vy_mps", "vz_mps"))
    return TruthPerson(
        id=row["id"],
        position_m=position,
        velocity_mps=velocity if np.isfinite(velocity).all() else None,
        yaw_rad=_angle(row, "yaw_rad"),
        path_yaw_rad=_angle(row, "path_yaw_rad"),
    )


def _vector(row: Row, names: tuple[str, ...]) -> F64:
    return np.array([_number(row, name) for name in names])


def _angle(row: Row, name: str) -> float | None:
    angle_rad = _number(row, name)
    return angle_rad if math.isfinite(angle_rad) else None


def _number(row: Row, name: str) -> float:
    text = row.get(name) or "nan"
    try:
        return float(text)
    except ValueError as error:
        raise ValueError(f"{name}: expected a number, got {text!r:.40}") from error
