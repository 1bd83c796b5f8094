"""Commands `people4d down`, `scale`, `health` and `run`."""

import os
import socket
import sys
import time
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

import services
from deploy.cli.options import Connect, ReadyTimeout, Robot, open_client
from deploy.cli.terminal import console, print_progress
from deploy.launcher import launcher, scaling
from deploy.launcher.health import Heartbeats, works
from deploy.launcher.state import State
from people4d.client import Client
from people4d.errors import ConfigError, People4dError
from people4d.messages import Health

CONTEXT_SETTINGS = {"run": {"allow_extra_args": True, "ignore_unknown_options": True}}


def down(robot: Robot = "robot") -> None:
    """Stop the system that people4d up started, in reverse order."""
    stopped = launcher.stop(State.of_robot(robot))
    typer.echo("Stopped." if stopped else f"Nothing runs for {robot}.")


def scale(
    requests: Annotated[
        list[str] | None,
        typer.Argument(metavar="SERVICE=N...", help="Number of replicas, detector=3."),
    ] = None,
    robot: Robot = "robot",
    timeout_s: ReadyTimeout = 60.0,
    force: Annotated[
        bool, typer.Option("--force", help="Start more than there are cores or memory for.")
    ] = False,
) -> None:
    """Change the number of replicas of a service while the system runs.

    Detectors share the frames of all cameras, reid processes the crops. If a new process does not
    become ready, all new processes are stopped. Without SERVICE=N it prints the current numbers.
    """
    state = State.of_robot(robot)
    running = state.read()
    if not running:
        raise People4dError(f"nothing runs here for {robot}", "Start it with people4d up.")
    with closing(Heartbeats(running.connect, robot)) as heartbeats:
        scaling.scale(state, requests or [], heartbeats, timeout_s, print_progress, force)
    for service in launcher.read_plan(state):
        console.print(f"{service.name}={service.replicas}", markup=False)


def health(
    service: Annotated[str, typer.Argument(help="Name of the service, for example detector.")],
    timeout_s: Annotated[
        float, typer.Option("--timeout", min=0.1, help="Longest wait in seconds.")
    ] = 3.0,
    ready: Annotated[
        bool, typer.Option("--ready", help="Require ready; degraded is not sufficient.")
    ] = False,
    here: Annotated[bool, typer.Option("--here", help="Only a process on this host.")] = False,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Exit with 0 once a process of the service is ready or degraded.

    `people4d doctor` checks the entire system and suggests remedies.
    """
    host = socket.gethostname()
    deadline_s = time.monotonic() + timeout_s
    last: Health | None = None
    with _connected(connect, robot, deadline_s) as client:
        for message in client.messages(Health, timeout_s=timeout_s):
            if message.service == service and (not here or message.host == host):
                last = message
                if last.state == "ready" or (works(last) and not ready):
                    typer.echo(f"{last.instance} is {last.state}. {last.reason}".strip())
                    return
            if time.monotonic() > deadline_s:
                break
        found = client.found()
    if last:
        raise People4dError(f"{last.instance} is {last.state}: {last.reason}")
    raise People4dError(f"no heartbeat of {service} arrived within {timeout_s:g} s", f"{found}.")


def _connected(connect: str, robot: str, deadline_s: float) -> Client:
    """Connect to the router, which may not be up yet."""
    while True:
        try:
            return open_client(connect, robot)
        except ConfigError:
            raise
        except People4dError:
            if time.monotonic() > deadline_s:
                raise


def run(
    context: typer.Context,
    service: Annotated[str, typer.Argument(help="Name of the service, for example detector.")],
) -> None:
    """Run one service in this terminal: python -m services.SERVICE with the same arguments."""
    if not service.isidentifier() or not find_spec(f"services.{service}"):
        folders = sorted(Path(services.__path__[0]).glob("*/__main__.py"))
        names = ", ".join(file.parent.name for file in folders)
        raise People4dError(f"unknown service {service!r}", f"Services are {names}.")
    os.execv(sys.executable, [sys.executable, "-m", f"services.{service}", *context.args])
