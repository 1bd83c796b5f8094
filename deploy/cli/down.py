"""people4d down."""

import typer

from deploy.cli.options import Robot
from deploy.launcher.launcher import stop
from deploy.launcher.state import State


def down(robot: Robot = "robot") -> None:
    """Stop everything that people4d up started, last started first."""
    stopped = stop(State.of_robot(robot))
    typer.echo("Stopped." if stopped else f"Nothing runs for {robot}.")
