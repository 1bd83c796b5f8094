"""Command `people4d follow`."""

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Annotated, Any

import numpy as np
import typer

from deploy.cli.live.enrol import Action, check_target_runs, make_command
from deploy.cli.options import SILENCE_S, Connect, Once, Robot, Timeout, open_client
from deploy.cli.terminal import shown
from people4d.client import Client
from people4d.errors import People4dError
from people4d.messages import Target, TargetCommand

CHOOSER = "people4d follow"
ID_MAX = 2**63 - 1
ANSWER_S = 3.0  # maximum wait for the answer to the own command [s]


def follow(
    id_: Annotated[
        int | None,
        typer.Argument(metavar="ID", min=1, max=ID_MAX, help="Track of the person to follow."),
    ] = None,
    nearest: Annotated[bool, typer.Option("--nearest", help="Follow the nearest person.")] = False,
    raised_hand: Annotated[
        bool, typer.Option("--raised-hand", help="Follow the nearest person with a raised hand.")
    ] = False,
    name: Annotated[
        str | None, typer.Option(help="Follow the person enrolled under this name; see enrol.")
    ] = None,
    at: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="X Y", help="Follow the person at this position in metres."),
    ] = None,
    stop: Annotated[bool, typer.Option("--stop", help="Follow no person.")] = False,
    once: Once = False,
    timeout_s: Timeout = None,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Choose the person to follow, and show the state of the chosen person until Ctrl-C.

    Without a choice it shows the state only. It needs a system with --target.
    """
    command = command_of(
        {
            "id": id_,
            "nearest": nearest,
            "raised_hand": raised_hand,
            "name": name,
            "at": at,
            "none": stop,
        }
    )
    with open_client(connect, robot) as client, suppress(KeyboardInterrupt):
        check_target_runs(client)
        targets = client.messages(Target, timeout_s=timeout_s or SILENCE_S)
        if command:
            client.publish(command)
        target, end_s = None, time.monotonic() + ANSWER_S
        is_answered = command is None
        for target in targets if timeout_s else _while_running(client, targets):
            is_answered |= command is not None and target.answered_ns == command.stamp_ns
            if not is_answered and time.monotonic() < end_s:
                continue  # made before the choice
            typer.echo(line_of(target))
            if once:
                break
        if target is None:
            raise People4dError(
                f"no target arrived within {timeout_s:g} s", "people4d up --target."
            )


def _while_running(client: Client, targets: Iterator[Target]) -> Iterator[Target]:
    """Yield states without a limit of silence; People4dError once the service is gone."""
    while True:
        yield from targets
        check_target_runs(client)
        targets = client.messages(Target, timeout_s=SILENCE_S)


def command_of(asked: Mapping[Action, Any]) -> TargetCommand | None:
    """Return the choice of the options, None without one; BadParameter for several."""
    choices = [(action, value) for action, value in asked.items() if value not in (None, False)]
    if len(choices) > 1:
        raise typer.BadParameter("give one of ID, --nearest, --raised-hand, --name, --at, --stop")
    if not choices:
        return None
    action, value = choices[0]
    fields: dict[Action, dict[str, Any]] = {
        "id": {"id": value},
        "name": {"name": value},
        "at": {"position_m": np.array(value)},
    }
    return make_command(CHOOSER, action, **fields.get(action, {}))


def line_of(target: Target) -> str:
    """Return the state of the chosen person in one line."""
    parts = [f"{target.stamp_ns / 1e9:.2f}", f"{target.state:<9}"]
    if target.id is not None:
        parts.append(f"person {target.id}")
    if target.distance_m is not None and target.bearing_rad is not None:
        parts.append(f"{target.distance_m:.2f} m at {math.degrees(target.bearing_rad):.0f} deg")
    parts += [f"probability {target.probability:.2f}", shown(target.reason)]
    return "  ".join([*parts, *(["stop"] if target.stop else [])])
