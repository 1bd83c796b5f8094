"""The command line: people4d."""

import importlib
import importlib.metadata
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer
import typer.core
from rich.console import Console

from common.runtime.threads import THREADS
from deploy.cli.terminal import Command, CommandGroup, shown
from people4d.errors import People4dError

# Command, its module in this package, its line in the help. Modules are imported on use, which
# keeps help and completion fast.
COMMANDS = (
    ("up", "system.up", "Start the system and supervise it; Ctrl-C stops it."),
    ("demo", "system.demo", "Run the pipeline on the shipped recording and write a report."),
    ("down", "system.control", "Stop the system."),
    ("scale", "system.control", "Change the number of replicas of a service, live: detector=3."),
    ("ps", "system.ps", "Show processes: state, health, rates, drops."),
    ("top", "live.top", "Show the duration of every stage, rates, losses and ages, live."),
    ("trace", "live.trace", "Write the path of frames through all processes, for Perfetto."),
    ("export", "live.export", "Serve latency and health to Prometheus or OpenTelemetry."),
    ("logs", "system.logs", "Show the logs of the processes."),
    ("listen", "live.views", "Show the tracks, live."),
    ("follow", "live.follow", "Choose the person to follow; show the state, live."),
    ("enrol", "live.enrol", "Store the views of the locked person under a name."),
    ("forget", "live.enrol", "Delete the stored views of a person."),
    ("view", "live.view", "Show people and images in Rerun or Foxglove, or write a file for them."),
    ("open", "live.page", "Open the page of people4d up --dashboard in the browser."),
    ("score", "live.views", "Show the errors of the tracks against the ground truth, live."),
    ("cameras", "system.cameras", "List cameras that are plugged in, and why one is unusable."),
    ("calibrate", "live.calibrate", "Find poses and clocks of several cameras by walking."),
    ("info", "data.info", "Show the content of a recording, bag or folder; check it."),
    ("lab", "lab.simulate", "Simulate people: list scenarios, render, preview, export."),
    ("evaluate", "lab.evaluate", "Score methods on recordings with ground truth; write a report."),
    ("annotate", "lab.annotate", "Mark people in a recording in the browser; compare annotators."),
    ("compare", "lab.compare", "Compare two reports of evaluate, with intervals."),
    ("tune", "lab.tune", "Search settings on a recording with ground truth; write a preset."),
    ("gait", "lab.gait", "Track heads, hands and feet in a recording; measure gait."),
    ("models", "data.models", "List models: presence, licence, source; verify their files."),
    ("record", "data.record", "Record messages to a file, in parts, or around events."),
    ("cut", "data.cut", "Write a part of a recording to another one."),
    ("anonymise", "data.anonymise", "Black out heads in a recording, or remove its colour."),
    ("csv", "data.csv", "Write ground truth and tracks of a recording to CSV or Parquet."),
    ("events", "data.events", "Show the events of a robot, or write them to CSV."),
    ("replay", "data.replay", "Publish recorded messages, to try one service alone."),
    ("doctor", "system.doctor", "Find out why there is no output, with a remedy."),
    ("health", "system.control", "Exit with 0 once a service is healthy."),
    ("run", "system.control", "Run one service in this terminal."),
    ("settings", "system.settings", "Show all settings with units and defaults."),
    ("keys", "system.keys", "Make certificates or passwords for hosts and roles, or check them."),
)


UsageError: Any = typer.BadParameter.__base__  # typer exports no name of it


class LazyCommand(typer.core.TyperCommand):
    """Placeholder of a command, which is imported on use."""

    def __init__(self, name: str, module: str, line: str) -> None:
        super().__init__(name, help=line, short_help=line)
        self._module = module

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Create the context of the real command."""
        module = importlib.import_module(f"deploy.cli.{self._module}")
        if hasattr(module, "group"):  # sub-commands
            return typer.main.get_command(module.group()).make_context(*args, **kwargs)
        app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        settings = getattr(module, "CONTEXT_SETTINGS", {}).get(self.name)
        real = getattr(module, str(self.name))
        app.command(self.name, cls=Command, context_settings=settings)(real)
        return typer.main.get_command(app).make_context(*args, **kwargs)


@contextmanager
def _plain_usage() -> Iterator[None]:
    """Print errors of usage without a box."""
    try:
        yield
    except UsageError as error:
        error.show()
        raise typer.Exit(error.exit_code) from error


class Commands(CommandGroup):
    """All commands; a People4dError is printed as one sentence, wrong usage as plain text."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.commands = {name: LazyCommand(name, module, line) for name, module, line in COMMANDS}

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Create the context."""
        with _plain_usage():
            return super().make_context(*args, **kwargs)

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002
        """Return the names in the order of use."""
        return list(self.commands)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        try:
            with _plain_usage():
                return super().invoke(ctx)
        except People4dError as error:
            if ctx.params["debug"]:
                raise
            print_error(error)
            raise typer.Exit(1) from error


app = typer.Typer(
    cls=Commands, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode="rich"
)


def print_error(error: People4dError) -> None:
    """Print an error to stderr, after the end of its log."""
    console = Console(stderr=True, soft_wrap=True)
    log = getattr(error, "tail", "")
    if log:
        for line in log.splitlines():
            console.print(shown(line), style="dim", highlight=False)
    console.print("[bold red]error:[/]", end=" ")
    for line in str(error).splitlines():
        console.print(shown(line), highlight=False)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"people4d {importlib.metadata.version('people4d')}")
        raise typer.Exit


@app.callback()
def people4d(
    debug: Annotated[bool, typer.Option("--debug", help="Show the trace of an error.")] = False,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Track people in real time: position, velocity, orientation, identity."""
    del debug, version  # read by Commands.invoke and _show_version


def main() -> None:
    """Run the command line."""
    THREADS.watch()
    app(prog_name="people4d")
