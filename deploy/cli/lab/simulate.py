"""Command `people4d lab`."""

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from common.config import load
from deploy.cli.options import Fidelity, Jobs
from deploy.cli.terminal import (
    Command,
    CommandGroup,
    console,
    cores,
    interruptible,
    plain_table,
    progress,
    shown,
)
from lab.catalogue import load_scenario, scenario_names
from lab.scenario import Scenario
from people4d.errors import ConfigError

# Modules that draw are imported on use: compiled code takes a second to load.

ScenarioName = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="Name from people4d lab list, or a .toml file.")
]
Seed = Annotated[
    int | None,
    typer.Option(min=0, help="Seed of light, motion and noise; default: the scenario's own."),
]


def list_() -> None:
    """List the scenarios and the simulated people."""
    from lab.bodies.cast import load_cast  # noqa: PLC0415

    columns = ("scenario", ">people", ">length", "room", "camera", "about")
    table = plain_table(*columns)
    for name in scenario_names():
        scenario = load_scenario(name)
        camera = scenario.camera
        table.add_row(
            f"[bold]{name}[/]",
            str(len(scenario.people)),
            f"{scenario.duration_s:g} s",
            scenario.room,
            f"{'drives' if camera.drive else 'stands'}, {camera.fps:g} Hz",
            scenario.about,
        )
    console.print(table)
    console.print(f"\n[bold]people[/]  {', '.join(load_cast())}")
    console.print("\nPreview one: people4d lab preview SCENARIO")
    console.print("Run the pipeline on it: people4d up --source lab:SCENARIO")


def render(
    scenario: ScenarioName,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder or name of the recording; default: the scenario's name, here."),
    ] = None,
    seed: Seed = None,
    fidelity: Fidelity = "colour",
    format_: Annotated[
        Literal["recording", "ros2", "both"],
        typer.Option("--format", help="People4d recording, ROS 2 bag, or both."),
    ] = "recording",
    jobs: Jobs = 0,
    quality: Annotated[int, typer.Option(min=1, max=100, help="JPEG quality of colour.")] = 90,
    samples: Annotated[
        int,
        typer.Option(min=1, max=2, help="Samples along each side of a pixel; 1: fast, aliased."),
    ] = 2,
    depth: Annotated[
        Literal["clean", "measured"],
        typer.Option(help="clean: small file; the sensor's errors are added during playback."),
    ] = "clean",
    truth_per_frame: Annotated[
        bool,
        typer.Option(
            "--truth-per-frame", help="Write keypoints, boxes and visibility to NAME.truth.npz."
        ),
    ] = False,
    set_: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="FIELD=VALUE",
            help="Sensor errors, for example sensor.noise_px=0.14; detector.recall=0.9 (geometry).",
        ),
    ] = [],  # noqa: B006 (typer copies it)
) -> None:
    """Render a scenario into a recording; the same command continues an interrupted one."""
    from lab.output import render as rendering  # noqa: PLC0415
    from lab.output.sequence import ErrorModels, RenderJob  # noqa: PLC0415

    if fidelity == "geometry" and format_ != "recording":
        raise ConfigError(
            "--fidelity geometry: a ROS bag needs images", "Leave --format on recording."
        )
    plan = load_scenario(scenario, seed)
    if truth_per_frame and plan.cameras:
        raise ConfigError("--truth-per-frame: the scenario has several cameras", "Leave it out.")
    job = RenderJob(
        scenario=plan,
        seed=plan.seed if seed is None else seed,
        fidelity=fidelity,
        depth=depth,
        quality=quality,
        samples=samples,
        truth_per_frame=truth_per_frame,
        errors=load(ErrorModels, "lab", overrides=set_, environment={}),
    )
    stem = _stem(plan, seed)
    file = out if out and out.suffix == ".mcap" else (out or Path()) / f"{stem}.mcap"
    outputs = rendering.Outputs(
        recording=None if format_ == "ros2" else file,
        bag=None if format_ == "recording" else file.with_name(f"{file.stem}_ros2"),
        truth=file.with_suffix(".truth.npz") if truth_per_frame else None,
    )
    hint = f"Finished frames are in {outputs.chunks}: the same command continues."
    with interruptible(hint), progress() as report:
        rendering.render(job, outputs, jobs or cores(), report)
    for path in outputs.paths:
        typer.echo(f"Wrote {path}")
    typer.echo(f"Its contents: people4d info {outputs.paths[0]}")


def preview(
    scenario: ScenarioName,
    out: Annotated[
        Path | None,
        typer.Option(help="A .png or .webm file; default: a .png named after the scenario."),
    ] = None,
    seed: Seed = None,
    every_s: Annotated[
        float | None, typer.Option("--every", min=0.0, help="Seconds between images.")
    ] = None,
    fidelity: Annotated[
        Literal["depth", "colour"], typer.Option(help="depth: people in flat colours, fast.")
    ] = "colour",
) -> None:
    """Draw a scenario with skeletons, boxes, depth, masks and a map, as one page or a video."""
    from lab.camera.frames import FrameRenderer, RenderSettings  # noqa: PLC0415
    from lab.output.preview import Preview, write_sheet, write_video  # noqa: PLC0415
    from lab.world import World  # noqa: PLC0415

    plan = load_scenario(scenario, seed)
    path = out or Path(f"{_stem(plan, seed)}.png")
    writers = {".png": write_sheet, ".webm": write_video}
    if path.suffix not in writers:
        raise ConfigError(f"--out: expected a .png or .webm file, got {path}")
    if path.exists():
        raise ConfigError(f"{path} exists already", "Remove it, or give another --out.")
    settings = RenderSettings(colour="drawn" if fidelity == "colour" else "flat", threads=cores())
    shown = Preview(FrameRenderer(World(plan, seed), settings))
    frames = shown.frames(every_s) if path.suffix == ".webm" else shown.few_frames(every_s)
    with interruptible("The preview is not complete."), progress() as report:
        writers[path.suffix](shown, frames, path, partial(report, "drawing"))
    typer.echo(f"Wrote {path}")


def export(
    recording: Annotated[Path, typer.Argument(help="A people4d recording, simulated or real.")],
    out: Annotated[Path, typer.Argument(help="Folder of the ROS 2 bag.")],
    storage: Annotated[
        Literal["mcap", "sqlite3"], typer.Option(help="Storage format of the bag.")
    ] = "mcap",
    compressed: Annotated[
        bool, typer.Option("--compressed", help="JPEG colour and PNG depth, ten times smaller.")
    ] = False,
    namespace: Annotated[str, typer.Option(help="First part of the image topics.")] = "camera",
    camera: Annotated[str, typer.Option(help="Camera, if there are several.")] = "",
    people: Annotated[
        Literal["nav2", "sfm"], typer.Option(help="Convention of people, by their reader.")
    ] = "nav2",
) -> None:
    """Write a recording as a ROS 2 bag with the topics of a RealSense driver."""
    from services.camera.ros import export as ros_export  # noqa: PLC0415

    layout = ros_export.BagFormat(storage, compressed, namespace, people)
    with interruptible("Nothing was written."), progress() as report:
        counts = ros_export.export(recording, out, layout, camera, partial(report, "writing"))
    for topic, count in sorted(counts.items()):
        console.print(f"{count:>8} {shown(topic)}")
    typer.echo(f"Wrote {out}")


def _stem(plan: Scenario, seed: int | None) -> str:
    return plan.name if seed is None else f"{plan.name}-{seed}"


def group() -> typer.Typer:
    """Return the command with its sub-commands."""
    app = typer.Typer(
        cls=CommandGroup, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
    )
    app.command("list", cls=Command)(list_)
    for command in (render, preview, export):
        app.command(cls=Command)(command)
    return app
