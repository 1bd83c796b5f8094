"""Tables, JSON and progress bars in the terminal, and interruption by Ctrl-C."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Literal

import msgspec
import typer
import typer.core
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress, TaskID, TimeElapsedColumn
from rich.table import Table

from common.extras import install, missing

COLOURS = {"ready": "green", "degraded": "yellow", "starting": "cyan", "exited": "dim", "": "dim"}

console = Console(highlight=False, soft_wrap=True)

Report = Callable[[str, float], None]  # reports the name of a task and its progress


class _UntypedFlags:
    """Shows flags without a type in the help."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters for the help."""
        parameters: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for parameter in parameters:
            if getattr(parameter, "is_flag", False):
                parameter.metavar = ""
        return parameters


class Command(_UntypedFlags, typer.core.TyperCommand):
    """A command whose help shows flags without a type."""


class CommandGroup(_UntypedFlags, typer.core.TyperGroup):
    """A command with sub-commands."""


def plain_table(*titles: str, title: str | None = None, **column: Any) -> Table:
    """Create a table without lines; a title with ">" aligns its column right."""
    table = Table(title=title, title_justify="left", box=None, header_style="bold", pad_edge=False)
    for name in titles:
        justify: Literal["left", "right"] = "right" if name.startswith(">") else "left"
        table.add_column(name.removeprefix(">"), justify=justify, **column)
    return table


def print_table(table: Table) -> None:
    """Print a complete table, also in a narrower terminal."""
    widest = console.options.update(max_width=1000)
    width = max(console.width, console.measure(table, options=widest).maximum)
    Console(width=width, highlight=False).print(table)


def shown(text: object) -> str:
    """Return untrusted text as literal markup; control characters become spaces."""
    return escape("".join(c if c.isprintable() else " " for c in str(text)))


def coloured_state(state: str) -> str:
    """Return the state of a process as markup."""
    return f"[{COLOURS.get(state, 'red')}]{shown(state)}[/]"


def print_json(value: object) -> None:
    """Print a line of JSON."""
    typer.echo(msgspec.json.encode(value, enc_hook=lambda array: array.tolist()).decode())


def print_progress(name: str, what: str) -> None:
    """Print an event of a service or process."""
    console.print(f"  [bold]{shown(name):<12}[/] {shown(what)}")


def can_draw_figures() -> bool:
    """Check that matplotlib is installed; print a remedy otherwise."""
    if not missing("evaluate"):
        return True
    typer.echo(f"No figures: matplotlib is not installed. {install('evaluate')}")
    return False


def cores() -> int:
    """Return the number of usable cores."""
    return len(os.sched_getaffinity(0))


@contextmanager
def progress() -> Iterator[Report]:
    """Show a progress bar for each task; yield the function that reports progress."""
    with Progress(
        *Progress.get_default_columns(), TimeElapsedColumn(), console=Console(stderr=True)
    ) as bars:
        tasks: dict[str, TaskID] = {}

        def report(what: str, share: float) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(shown(what), total=1.0)
            bars.update(tasks[what], completed=share)

        yield report


@contextmanager
def signals_interrupt() -> Iterator[None]:
    """Raise KeyboardInterrupt also for SIGTERM and a closed terminal."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def interrupt(*_: object) -> None:
        for number in numbers:  # a second signal must not interrupt the stop
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    before = [signal.signal(number, interrupt) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


@contextmanager
def interruptible(message: str) -> Iterator[None]:
    """End the block on Ctrl-C, SIGTERM and a closed terminal, and print a message."""
    try:
        with signals_interrupt():
            yield
    except KeyboardInterrupt:
        typer.echo(f"Interrupted. {message}", err=True)
        raise typer.Exit(130) from None
