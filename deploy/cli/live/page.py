"""Command `people4d open`."""

import webbrowser
from typing import Annotated

import msgspec
import typer

from deploy.cli.options import Robot
from deploy.cli.terminal import console
from deploy.launcher.state import State
from people4d.errors import People4dError
from services.dashboard.address import ADDRESS_FILE, PageAddress


def open(
    robot: Robot = "robot",
    show: Annotated[
        bool, typer.Option("--print", help="Print the address only, with its token.")
    ] = False,
) -> None:
    """Open the page of a system on this machine in the browser."""
    address = page_address(State.of_robot(robot))
    if address is None:
        raise People4dError(f"{robot} serves no dashboard", "Start it: people4d up --dashboard.")
    console.print(address.login, markup=False)
    if not show and not webbrowser.open(address.login):
        console.print("No browser was found here; open the address in one.", markup=False)


def page_address(state: State) -> PageAddress | None:
    """Return the address of the page of a running system; None if it has none."""
    if state.read() is None:
        return None
    try:
        content = (state.folder / ADDRESS_FILE).read_bytes()
        return msgspec.json.decode(content, type=PageAddress)
    except (OSError, msgspec.DecodeError):
        return None
