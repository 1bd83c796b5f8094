"""Options that several commands share."""

import os
from typing import Annotated

import typer

from common.transport.zenoh_bus import ZenohBus, read_config
from deploy.launcher.state import State
from people4d.client import Client

CONNECT_S = 3.0

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
    return Client(_endpoint(connect, robot), robot)


def open_bus(connect: str, robot: str) -> ZenohBus:
    """Connect likewise, to publish."""
    endpoint = _endpoint(connect, robot)
    environment = dict(os.environ) | ({"PEOPLE4D_CONNECT": endpoint} if endpoint else {})
    return ZenohBus(read_config(None, "client", environment), robot, CONNECT_S)


def _endpoint(connect: str, robot: str) -> str:
    running = None if connect else State.of_robot(robot).read()
    return running.connect if running else connect
