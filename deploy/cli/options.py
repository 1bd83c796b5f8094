"""Options that several commands share."""

from typing import Annotated

import typer

from deploy.launcher.state import State
from people4d.client import Client

Robot = Annotated[
    str, typer.Option(envvar="PEOPLE4D_ROBOT", help="Name of the robot, part of every key.")
]
Connect = Annotated[
    str,
    typer.Option(
        envvar="PEOPLE4D_CONNECT",
        metavar="ENDPOINT",
        help="Router, for example tcp/192.168.1.7:7447; without it the one that runs here.",
    ),
]


def open_client(connect: str, robot: str) -> Client:
    """Connect to the named router, else to the one that people4d up started here."""
    running = None if connect else State.of_robot(robot).read()
    return Client(running.connect if running else connect, robot)
