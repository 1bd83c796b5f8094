"""Command `people4d demo`."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from common.config import setting
from common.transport.ports import free_port
from deploy.cli.options import Preset
from deploy.cli.system.launch import LOCKSTEP_WAITS, SIMULATED, START_TIMEOUT_S, launch
from deploy.launcher.plan import CAMERA, COMPOSE_FILE, REPORT, LaunchRequest
from deploy.launcher.state import State
from services.presets import preset_settings

DEMO = COMPOSE_FILE.parent / "demo" / "crossing.mcap"


def demo(
    preset: Preset = "",
    playback: Annotated[
        Literal["recorded", "lockstep"],
        typer.Option(help="At the recorded rate, or every frame, however long that takes."),
    ] = "recorded",
    report: Annotated[Path, typer.Option(help="Folder for the report.")] = Path("out/demo"),
    robot: Annotated[str, typer.Option(help="Name of the robot; default: a name of its own.")] = "",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the router; 0: a free one.")
    ] = 0,
) -> None:
    """Run the pipeline on the shipped recording and write a report."""
    port = port or free_port()
    settings = [
        *preset_settings(preset),
        setting(f"{CAMERA}.source", str(DEMO)),
        setting(f"{CAMERA}.playback", playback),
        *(LOCKSTEP_WAITS if playback == "lockstep" else ()),
        setting("gt_bridge.truth", str(DEMO)),
        setting(f"{REPORT}.note", SIMULATED),
    ]
    # Demos of several clones run at the same time, each as a separate robot.
    name = robot or f"demo-{port}"
    request = LaunchRequest(robot=name, port=port, settings=settings, report=report)
    launch(request, START_TIMEOUT_S, detach=False)
    if not robot:
        State.of_robot(name).remove()
