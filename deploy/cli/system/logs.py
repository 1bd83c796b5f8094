"""Command `people4d logs`."""

import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from deploy.cli.options import Robot
from deploy.cli.terminal import console, shown
from deploy.launcher.launcher import tail
from deploy.launcher.state import State, names_of
from people4d.errors import People4dError

POLL_S = 0.2
COLOURS = ("cyan", "green", "yellow", "magenta", "blue", "bright_cyan", "bright_magenta")


def logs(
    service: Annotated[
        str, typer.Argument(help="Service or process, for example detector or detector-2.")
    ] = "",
    follow: Annotated[
        bool, typer.Option("--follow", "-f", help="Follow the logs until Ctrl-C.")
    ] = False,
    lines: Annotated[
        int, typer.Option("--lines", "-n", min=0, help="Number of last lines of each log.")
    ] = 20,
    robot: Robot = "robot",
) -> None:
    """Show the logs of the processes of the current or last run."""
    files = _files(State.of_robot(robot).folder, service)
    colours = {file: COLOURS[n % len(COLOURS)] for n, file in enumerate(files)}

    def show(file: Path, line: str) -> None:
        console.print(f"[{colours[file]}]{file.stem:<12}[/]", end=" ")
        console.print(shown(line))

    for file in files:
        for line in tail(file, lines).splitlines():
            show(file, line)
    if follow:
        with suppress(KeyboardInterrupt):
            for file, line in _new_lines(files):
                show(file, line)


def _files(folder: Path, service: str) -> list[Path]:
    every = [file for file in sorted(folder.glob("*-*.log")) if file.stat().st_size]
    files = [
        file
        for file in every
        if any(service in ("", name, name.rpartition("-")[0]) for name in names_of(file))
    ]
    if not files:
        known = ", ".join(file.stem for file in every)
        raise People4dError(
            f"there is no log of {service or 'any process'} in {folder}",
            f"There are {known}." if known else "Start the system with people4d up.",
        )
    return files


def _new_lines(files: Sequence[Path]) -> Iterator[tuple[Path, str]]:
    """Yield new lines; a rotated log is read from its start."""
    offsets = {file: file.stat().st_size for file in files}
    while True:
        for file in files:
            if file.stat().st_size < offsets[file]:
                offsets[file] = 0
            with file.open("rb") as log:
                log.seek(offsets[file])
                for line in log:
                    if line.endswith(b"\n"):
                        offsets[file] += len(line)
                        yield file, line.decode(errors="replace").rstrip()
        time.sleep(POLL_S)
