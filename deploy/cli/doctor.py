"""people4d doctor."""

import os
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console

from deploy.cli.options import Connect, Robot
from deploy.doctor import here
from deploy.doctor.evidence import listen
from deploy.doctor.finding import Finding, Level, ok
from deploy.doctor.running import NEEDED, examine
from deploy.launcher.plan import Wish
from deploy.launcher.state import State
from people4d.client import Client
from people4d.errors import People4dError

COLOURS: dict[Level, str] = {"ok": "green", "warning": "yellow", "problem": "bold red"}
CONNECT_S = 3.0


def doctor(
    robot: Robot = "robot",
    connect: Connect = "",
    seconds: Annotated[
        float, typer.Option("--for", min=0.5, max=60.0, help="Seconds to listen.")
    ] = 3.0,
    config: Annotated[
        Path | None, typer.Option(help="TOML file whose settings are checked.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON list.")] = False,
) -> None:
    """Find why there is no output, and say what mends it; exit with 1 if there is a problem."""
    findings = _examine(robot, connect, seconds, config)
    if json:
        typer.echo(msgspec.json.encode(findings).decode())
    else:
        show(findings, Console(highlight=False, soft_wrap=True))
    if any(finding.level == "problem" for finding in findings):
        raise typer.Exit(1)


def _examine(robot: str, connect: str, seconds: float, config: Path | None) -> list[Finding]:
    state = State.of_robot(robot)
    run = state.read()
    endpoint = connect or (run.connect if run else Wish().connect)
    is_here = not connect or (run is not None and run.connect == connect)
    findings = list(here.running(state)) if is_here else []
    missing = True
    try:
        with Client(endpoint, robot, CONNECT_S) as client:
            evidence = listen(client, seconds)
        findings.append(ok("router", f"{endpoint} answers"))
        findings += examine(evidence)
        missing = any(not evidence.of(service) for service in NEEDED)
    except People4dError as error:
        findings.append(here.router(endpoint, error))
    if is_here and missing:
        findings += here.settings(config, os.environ)
    return findings


def show(findings: list[Finding], console: Console) -> None:
    """Print one line for each finding, and below it what mends it."""
    width = max(len(finding.check) for finding in findings)
    for finding in findings:
        level = f"[{COLOURS[finding.level]}]{finding.level:<7}[/]"
        console.print(f"{level}  {finding.check:<{width}}  ", end="")
        console.print(finding.what, markup=False)
        if finding.hint:
            console.print(f"{'':<{11 + width}}{finding.hint}", markup=False, style="dim")
    bad = sum(finding.level == "problem" for finding in findings)
    odd = sum(finding.level == "warning" for finding in findings)
    console.print()
    if bad or odd:
        console.print(f"{bad} problems, {odd} warnings.", markup=False)
    else:
        console.print("Everything is fine.")
