"""Bars for work that takes long, and its end on Ctrl-C."""

import importlib.util
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

Report = Callable[[str, float], None]


def cores() -> int:
    """Return the number of cores that may be used."""
    return len(os.sched_getaffinity(0))


@contextmanager
def progress() -> Iterator[Report]:
    """Show a bar for each thing that is being done; call what it gives with its share."""
    columns = (
        TextColumn("{task.description:<18}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bars:
        tasks: dict[str, TaskID] = {}

        def report(what: str, share: float) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=1.0)
            bars.update(tasks[what], completed=share)

        yield report


@contextmanager
def interruptible(message: str) -> Iterator[None]:
    """End the block on Ctrl-C, SIGTERM and a closed terminal, and say what there is."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    numbers = (signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, interrupt) for number in numbers]
    try:
        yield
    except KeyboardInterrupt:
        typer.echo(f"Interrupted. {message}", err=True)
        raise typer.Exit(130) from None
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def can_draw_figures() -> bool:
    """Return True if matplotlib is installed; say so otherwise."""
    if importlib.util.find_spec("matplotlib"):
        return True
    typer.echo("No figures: matplotlib is not installed (pip install 'people4d[evaluate]').")
    return False
