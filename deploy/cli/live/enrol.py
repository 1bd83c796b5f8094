"""people4d enrol and people4d forget."""

import time
from typing import Annotated, Literal

import typer

from deploy.cli.options import Connect, Robot, open_client
from people4d.errors import People4dError
from people4d.messages import Target, TargetCommand
from people4d.messages.base import NAME, NAME_FORM

PersonName = Annotated[str, typer.Argument(metavar="NAME", help="Name of the person.")]
Wait = Annotated[
    float, typer.Option("--timeout", min=0.1, help="Longest wait for the answer in seconds.")
]
WAIT_S = 10.0


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


def check_name(name: str) -> None:
    """Check a name; BadParameter if it is none."""
    if not NAME.fullmatch(name):
        raise typer.BadParameter(f"{name!r}: expected {NAME_FORM}")


def _ask(
    action: Literal["enrol", "forget"], name: str, timeout_s: float, robot: str, connect: str
) -> None:
    """Send a command, and wait for its answer; People4dError with the reason of a failure."""
    check_name(name)
    command = TargetCommand(
        stamp_ns=time.time_ns(), sequence=0, action=action, name=name, chooser=f"people4d {action}"
    )
    end_s = time.monotonic() + timeout_s
    with open_client(connect, robot) as client:
        targets = client.messages(Target, timeout_s=timeout_s)
        client.publish(command)
        for target in targets:
            if target.answered_ns == command.stamp_ns:
                if target.problem:
                    raise People4dError(f"{action} {name}: {target.problem}")
                return
            if time.monotonic() > end_s:
                break
    raise People4dError(
        f"no answer arrived within {timeout_s:g} s: answers come with frames",
        "Start people4d up --target with a source, and ask again.",
    )
