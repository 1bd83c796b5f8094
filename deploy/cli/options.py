"""Options that several commands share."""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Literal

import typer

from common.transport.zenoh_bus import ZenohBus, read_config
from deploy.launcher.state import State, running_robots
from people4d.client import Client
from people4d.errors import ConfigError, People4dError
from people4d.messages import Message
from people4d.session import SILENT, endpoints_of
from people4d.topics import BY_NAME
from services.presets import PRESETS

CONNECT_S = 3.0
NETWORK = "Network"  # panel of the help

SILENCE_S = 2.0  # maximum silence before present robots and services are printed [s]


def _running_robot(context: typer.Context, value: str) -> str:
    """Return the named robot, else the only robot that runs on this host."""
    source = context.get_parameter_source("robot")
    if context.params.get("connect") or (source and source.name != "DEFAULT"):
        return value
    running = running_robots()
    return running[0] if len(running) == 1 else value


def checked_time(value: float | None) -> float | None:
    """Return a time in seconds; BadParameter if it is not positive and finite."""
    if value is not None and not 0 < value < math.inf:
        raise typer.BadParameter(f"expected a positive number of seconds, got {value:g}")
    return value


def _endpoints(value: str) -> str:
    if "://" in value:
        raise ConfigError(f"{value!r} is not an endpoint", "Write it as tcp/192.168.1.7:7447.")
    return ",".join(endpoints_of(value))


NewRobot = Annotated[
    str,
    typer.Option(
        envvar="PEOPLE4D_ROBOT",
        help="Name of the robot, part of every key.",
        rich_help_panel=NETWORK,
    ),
]
Robot = Annotated[
    str,
    typer.Option(
        envvar="PEOPLE4D_ROBOT",
        callback=_running_robot,
        help="Name of the robot; default: the one that runs on this machine, if it is alone.",
        show_default=False,
        rich_help_panel=NETWORK,
    ),
]
Connect = Annotated[
    str,
    typer.Option(
        envvar="PEOPLE4D_CONNECT",
        metavar="ENDPOINT",
        callback=_endpoints,
        is_eager=True,  # parsed before --robot, whose default depends on it
        help="Router, for example tcp/192.168.1.7:7447; default: the one on this machine.",
        rich_help_panel=NETWORK,
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Once = Annotated[bool, typer.Option("--once", help="Show one message and exit.")]
Timeout = Annotated[
    float | None,
    typer.Option(
        "--timeout",
        callback=checked_time,
        help="Exit after this many seconds without a message.",
    ),
]
ReadyTimeout = Annotated[
    float,
    typer.Option(
        "--timeout",
        callback=checked_time,
        help="Longest wait in seconds until a process is ready.",
    ),
]
PRESET_HELP = f"Method with its settings: {', '.join(PRESETS)}, or a TOML file."
Preset = Annotated[str, typer.Option(help=PRESET_HELP)]
Settings = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="SERVICE.FIELD=VALUE",
        help="Any other setting, for example camera.max_frames=100.",
    ),
]
Fidelity = Annotated[
    Literal["geometry", "depth", "colour"],
    typer.Option(help="geometry: detections in place of frames. depth: people in flat colours."),
]
VisualOdometry = Annotated[
    bool, typer.Option("--visual-odometry", help="Estimate the base's motion from images.")
]
Figures = Annotated[
    bool, typer.Option(help="Draw figures, if matplotlib is installed, the extra 'evaluate'.")
]
Jobs = Annotated[
    int, typer.Option(min=0, help="Processes at once, one thread each; 0: one for each core.")
]


def open_client(connect: str, robot: str) -> Client:
    """Connect to the named router, or else to the router of people4d up on this host.

    Silence is explained on the terminal by the robots and services found. People4dError if no
    router answers.
    """
    with _router(connect, robot) as endpoint:
        return Client(endpoint, robot, CONNECT_S, SILENCE_S)


def open_bus(connect: str, robot: str) -> ZenohBus:
    """Connect like `open_client`, to publish."""
    with _router(connect, robot) as endpoint:
        environment = dict(os.environ) | ({"PEOPLE4D_CONNECT": endpoint} if endpoint else {})
        return ZenohBus(read_config(None, "client", environment), robot, CONNECT_S)


def kinds_of(topics: str) -> tuple[type[Message], ...]:
    """Return the message types of comma-separated topics."""
    names = [name.strip() for name in topics.split(",") if name.strip()]
    for name in names:
        if name not in BY_NAME:
            raise ConfigError(f"unknown topic {name!r}", f"Topics are {', '.join(BY_NAME)}.")
    return tuple(BY_NAME[name].message for name in names)


@contextmanager
def _router(connect: str, robot: str) -> Iterator[str]:
    """Yield the endpoint of the router; empty for the default one of this machine."""
    running = None if connect else State.of_robot(robot).read()
    endpoint = running.connect if running else connect
    try:
        yield endpoint
    except People4dError as error:
        if endpoint or SILENT not in error.problem:
            raise
        raise People4dError(
            f"no system of robot {robot} runs here",
            "people4d up starts one; --connect ENDPOINT names the router of another machine.",
        ) from error
