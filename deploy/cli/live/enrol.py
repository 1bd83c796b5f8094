"""Commands `people4d enrol` and `people4d forget`."""

import time
from typing import Annotated, Any, Literal

import typer

from deploy.cli.options import Connect, Robot, checked_time, open_client
from people4d.client import Client
from people4d.errors import People4dError
from people4d.messages import Target, TargetCommand

PersonName = Annotated[str, typer.Argument(metavar="NAME", help="Name of the person.")]
Wait = Annotated[
    float,
    typer.Option(
        "--timeout", callback=checked_time, help="Longest wait for the answer in seconds."
    ),
]
WAIT_S = 10.0
Action = Literal["id", "nearest", "at", "raised_hand", "name", "none", "enrol", "forget"]


def enrol(
    name: PersonName, timeout_s: Wait = WAIT_S, robot: Robot = "robot", connect: Connect = ""
) -> None:
    """Store the views of the locked person under a name, as embeddings without images.

    It needs a system with --target and target.enrolment_days, and the person's consent.
    """
    _ask("enrol", name, timeout_s, robot, connect)
    typer.echo(f"enrolled {name}")


def forget(
    name: PersonName, timeout_s: Wait = WAIT_S, robot: Robot = "robot", connect: Connect = ""
) -> None:
    """Delete the stored views of a person, and stop following that person."""
    _ask("forget", name, timeout_s, robot, connect)
    typer.echo(f"forgot {name}")


def make_command(chooser: str, action: Action, **fields: Any) -> TargetCommand:
    """Return a command to the target service; BadParameter if a value is invalid."""
    try:
        return TargetCommand(
            stamp_ns=time.time_ns(), sequence=0, chooser=chooser, action=action, **fields
        )
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


def check_target_runs(client: Client) -> None:
    """Check that the service of the chosen person runs; People4dError otherwise."""
    robot = client.session.robot
    if not any(found[:2] == (robot, "target") for found in client.session.present()):
        raise People4dError(
            f"the target service of robot {robot} does not run",
            f"Start it with people4d up ... --target; {client.found()}.",
        )


def _ask(
    action: Literal["enrol", "forget"], name: str, timeout_s: float, robot: str, connect: str
) -> None:
    """Send a command, and wait for its answer; People4dError with the reason of a failure."""
    command = make_command(f"people4d {action}", action, name=name)
    end_s = time.monotonic() + timeout_s
    with open_client(connect, robot) as client:
        check_target_runs(client)
        targets = client.messages(Target, timeout_s=timeout_s)
        client.publish(command)
        for target in targets:
            if target.answered_ns == command.stamp_ns:
                if target.problem:
                    raise People4dError(f"{action} {name}: {target.problem}")
                return
            if time.monotonic() > end_s:
                break
    raise People4dError(f"no answer arrived within {timeout_s:g} s", "people4d up --target.")
