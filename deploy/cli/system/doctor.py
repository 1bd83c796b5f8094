"""Command `people4d doctor`: diagnostics of a running system, with remedies."""

import os
from pathlib import Path
from typing import Annotated

import typer

from common.diagnosis.checks import NEEDED, examine
from common.diagnosis.evidence import Diagnostic, Level, listen, ok
from deploy.cli.options import Connect, Json, Robot
from deploy.cli.terminal import console, print_json, shown
from deploy.doctor import here
from deploy.launcher.plan import LaunchRequest
from deploy.launcher.state import State
from people4d.client import Client
from people4d.errors import People4dError

COLOURS: dict[Level, str] = {"ok": "green", "warning": "yellow", "problem": "bold red"}
CONNECT_S = 3.0


def doctor(
    robot: Robot = "robot",
    connect: Connect = "",
    seconds: Annotated[
        float, typer.Option("--seconds", min=0.5, max=60.0, help="Seconds to listen.")
    ] = 3.0,
    config: Annotated[
        Path | None, typer.Option(help="TOML file whose settings are checked.")
    ] = None,
    json: Json = False,
) -> None:
    """Find out why there is no output, with a remedy; exit with 1 if there is a problem."""
    diagnostics = _examine(robot, connect, seconds, config)
    if json:
        print_json(diagnostics)
    else:
        _show(diagnostics)
    if any(diagnostic.level == "problem" for diagnostic in diagnostics):
        raise typer.Exit(1)


def _examine(robot: str, connect: str, seconds: float, config: Path | None) -> list[Diagnostic]:
    state = State.of_robot(robot)
    run = state.read()
    endpoint = connect or (run.connect if run else LaunchRequest().connect)
    is_here = not connect or (run is not None and run.connect == connect)
    diagnostics = list(here.running(state)) if is_here else []
    missing = True
    try:
        with Client(endpoint, robot, CONNECT_S) as client:
            evidence = listen(client, seconds)
        diagnostics.append(ok("router", f"{endpoint} answers"))
        diagnostics += examine(evidence)
        missing = any(not evidence.of_service(service) for service in NEEDED)
    except People4dError as error:
        diagnostics.append(here.router(endpoint, error))
    if is_here and missing:
        diagnostics += here.settings(config, os.environ)
    return diagnostics


def _show(diagnostics: list[Diagnostic]) -> None:
    """Print one line for each diagnostic, with the hint below it."""
    width = max(len(diagnostic.check) for diagnostic in diagnostics)
    for diagnostic in diagnostics:
        level = f"[{COLOURS[diagnostic.level]}]{diagnostic.level:<7}[/]"
        console.print(f"{level}  {diagnostic.check:<{width}}  ", end="")
        console.print(shown(diagnostic.what))
        if diagnostic.hint:
            console.print(f"{'':<{11 + width}}{diagnostic.hint}", markup=False, style="dim")
    bad = sum(diagnostic.level == "problem" for diagnostic in diagnostics)
    odd = sum(diagnostic.level == "warning" for diagnostic in diagnostics)
    console.print()
    if bad or odd:
        console.print(f"{bad} problems, {odd} warnings.", markup=False)
    else:
        console.print("Everything is fine.")
