"""Tables, JSON and progress bars in the terminal, and the end of long work on Ctrl-C."""

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

Report = Callable[[str, float], None]  # takes the name of a piece of work, and the share done


class _UntypedFlags:
    """Shows an option that takes no value without a type."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters for the help."""
        parameters: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for parameter in parameters:
            if getattr(parameter, "is_flag", False):
                parameter.metavar = ""
        return parameters


class Command(_UntypedFlags, typer.core.TyperCommand):
    """A command."""


class CommandGroup(_UntypedFlags, typer.core.TyperGroup):
    """A command with commands of its own."""


def plain_table(*titles: str, title: str | None = None, **column: Any) -> Table:
    """Make a table without lines; columns whose title begins with ">" are aligned right."""
    table = Table(title=title, title_justify="left", box=None, header_style="bold", pad_edge=False)
    for name in titles:
        justify: Literal["left", "right"] = "right" if name.startswith(">") else "left"
        table.add_column(name.removeprefix(">"), justify=justify, **column)
    return table


def print_table(table: Table) -> None:
    """Print a table, entire where the terminal is narrower: no column of figures is cut off."""
    widest = console.options.update(max_width=1000)
    width = max(console.width, console.measure(table, options=widest).maximum)
    Console(width=width, highlight=False).print(table)


def shown(text: object) -> str:
    """Return text of others as markup that shows it as it is.

    What a terminal takes for a command, line breaks among them, becomes a space; square brackets
    are no markup.
    """
    return escape("".join(c if c.isprintable() else " " for c in str(text)))


def coloured_state(state: str) -> str:
    """Return the state of a process as markup."""
    return f"[{COLOURS.get(state, 'red')}]{shown(state)}[/]"


def print_json(value: object) -> None:
    """Print a line of JSON."""
    typer.echo(msgspec.json.encode(value, enc_hook=lambda array: array.tolist()).decode())


def print_progress(name: str, what: str) -> None:
    """Print what happened to a service or process."""
    console.print(f"  [bold]{shown(name):<12}[/] {shown(what)}")


def can_draw_figures() -> bool:
    """Return True if matplotlib is installed; say so otherwise."""
    if not missing("evaluate"):
        return True
    typer.echo(f"No figures: matplotlib is not installed. {install('evaluate')}")
    return False


def cores() -> int:
    """Return the number of cores that may be used."""
    return len(os.sched_getaffinity(0))


@contextmanager
def progress() -> Iterator[Report]:
    """Show a bar for each thing that is being done; call what it gives with its share."""
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
    """Let SIGTERM and a closed terminal end the block as Ctrl-C does, with KeyboardInterrupt."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def interrupt(*_: object) -> None:
        for number in numbers:  # once is enough: what follows is the stop, which must not break off
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
