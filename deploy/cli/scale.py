"""people4d scale."""

from typing import Annotated

import typer
from rich.console import Console

from deploy.cli.options import Robot
from deploy.launcher.health import Heartbeats
from deploy.launcher.scale import read_plan
from deploy.launcher.scale import scale as rescale
from deploy.launcher.state import State
from people4d.errors import People4dError

START_TIMEOUT_S = 60.0

console = Console(highlight=False, soft_wrap=True)


def scale(
    requests: Annotated[
        list[str] | None,
        typer.Argument(metavar="SERVICE=N...", help="Number of equal processes, detector=3."),
    ] = None,
    robot: Robot = "robot",
    timeout_s: Annotated[
        float, typer.Option("--timeout", help="Seconds that a new process may take to get ready.")
    ] = START_TIMEOUT_S,
) -> None:
    """Change how many processes of a service run, while everything goes on.

    Detectors share the frames of all cameras by turns, reids the pictures of people.
    Without SERVICE=N it tells how many there are.
    """
    state = State.of_robot(robot)
    running = state.read()
    if not running:
        raise People4dError(f"nothing runs here for {robot}", "Start it with people4d up.")
    heartbeats = Heartbeats(running.connect, robot)
    try:
        rescale(state, requests or [], heartbeats, timeout_s, _progress)
    finally:
        heartbeats.close()
    for service in read_plan(state):
        console.print(f"{service.name}={service.replicas}", markup=False)


def _progress(name: str, what: str) -> None:
    console.print(f"  [bold]{name:<12}[/] {what}")
