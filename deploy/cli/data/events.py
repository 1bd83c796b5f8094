"""Command `people4d events`."""

import csv
import sqlite3
import sys
from datetime import datetime
from pathlib import Path
from typing import Annotated, TextIO

import typer

from deploy.cli.data.targets import check_folder
from deploy.cli.options import Robot
from deploy.cli.terminal import console, plain_table, shown
from deploy.launcher.state import State
from people4d.errors import ConfigError
from people4d.messages import Event
from services.events.journal import JOURNAL, Journal

COLUMNS = (
    *("sequence", "stamp_ns", "kind", "id", "zone", "x_m", "y_m", "z_m", "frame_id"),
    *("dwell_s", "count", "distance_m", "confidence", "reason", "target_x_m", "target_y_m"),
    "wall_ns",
)
SHOWN = 30


def events(
    robot: Robot = "robot",
    to: Annotated[
        Path | None, typer.Option("--csv", help="Write all events to this file; -: to the output.")
    ] = None,
) -> None:
    """Show the last events of a robot on this machine, or write all of them to CSV."""
    file = State.of_robot(robot).folder / JOURNAL
    if not file.is_file():
        raise ConfigError(
            f"no events of {robot} are stored here", "Start it: people4d up --events."
        )
    journal = Journal(file, 1)
    try:
        found = journal.after(-1 if to else journal.last_number() - SHOWN)
    except sqlite3.Error as error:
        raise ConfigError(f"the journal {file} cannot be read: {error}") from error
    finally:
        journal.close()
    if to is None:
        _show(found)
    elif str(to) == "-":
        _write(found, sys.stdout)
    else:
        check_folder(to)
        with to.open("w", encoding="utf-8", newline="") as out:
            _write(found, out)
        console.print(f"{len(found)} events: {to}", markup=False)


def _row(event: Event) -> list[object]:
    x, y, z = ("", "", "") if event.position_m is None else event.position_m.round(3).tolist()
    first = (event.sequence, event.stamp_ns, event.kind, event.id, event.zone, x, y, z)
    rest = (event.frame_id, event.dwell_s, event.count, event.distance_m)
    target = (None, None) if event.target_m is None else event.target_m[:2].round(3).tolist()
    values = (*first, *rest, event.confidence, event.reason, *target, event.wall_ns)
    return ["" if value is None else value for value in values]


def _write(found: list[Event], out: TextIO) -> None:
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(map(_row, found))


def _show(found: list[Event]) -> None:
    table = plain_table(">number", "when", "event", ">person", "zone", "about")
    for event in found:
        figures = {"s": event.dwell_s, "people": event.count, "m": event.distance_m}
        about = ", ".join(
            f"{value:g} {unit}" for unit, value in figures.items() if value is not None
        )
        person = "" if event.id is None else str(event.id)
        about = about or shown(event.reason)
        row = (_when(event.wall_ns), event.kind, person, shown(event.zone), about)
        table.add_row(str(event.sequence), *row)
    console.print(table)


def _when(wall_ns: int | None) -> str:
    """Format a wall clock in local time; empty if it is unknown."""
    if wall_ns is None:
        return ""
    return f"{datetime.fromtimestamp(wall_ns // 10**9):%Y-%m-%d %H:%M:%S}"
