"""people4d health."""

import socket
import time
from typing import Annotated

import typer

from deploy.cli.options import Connect, Robot, open_client
from deploy.launcher.health import works
from people4d.errors import People4dError
from people4d.messages import Health


def health(
    service: Annotated[str, typer.Argument(help="Name of the service, for example detector.")],
    timeout_s: Annotated[
        float, typer.Option("--timeout", min=0.1, help="Longest wait in seconds.")
    ] = 3.0,
    ready: Annotated[bool, typer.Option("--ready", help="Degraded is not good enough.")] = False,
    here: Annotated[bool, typer.Option("--here", help="Only a process on this host.")] = False,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Exit with 0 once a process of the service tells that it works, if with limits.

    `people4d doctor` looks at the whole system and says what to do.
    """
    host = socket.gethostname()
    deadline_s = time.monotonic() + timeout_s
    last: Health | None = None
    with open_client(connect, robot) as client:
        for message in client.messages(Health, timeout_s=timeout_s):
            if message.service == service and (not here or message.host == host):
                last = message
                if last.state == "ready" or (works(last) and not ready):
                    typer.echo(f"{last.instance} is {last.state}. {last.reason}".strip())
                    return
            if time.monotonic() > deadline_s:
                break
    if last:
        raise People4dError(f"{last.instance} is {last.state}: {last.reason}")
    raise People4dError(f"no heartbeat of {service} came within {timeout_s:g} s")
