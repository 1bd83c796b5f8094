"""Command `people4d gait`."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from deploy.cli.options import Preset, Settings
from deploy.cli.terminal import interruptible, plain_table, print_table, progress
from lab import catalogue as scenarios
from people4d.errors import ConfigError

# The report is imported on use: compiled code takes a second to load.

if TYPE_CHECKING:
    from evaluation.gait.tables import GaitTables

AUTO = "auto"
BOX = re.compile(r"\s*-?\d+(\.\d+)?\s*(,\s*-?\d+(\.\d+)?\s*){3}")


def gait(
    recording: Annotated[
        str,
        typer.Argument(
            help="Recording, ROS bag, folder of images, or lab:SCENARIO.", metavar="RECORDING"
        ),
    ],
    person: Annotated[
        str,
        typer.Option(
            metavar="auto|LEFT,TOP,RIGHT,BOTTOM",
            help="auto: all people, detected and tracked. A box in the first frame, in pixels: the "
            "person in it, tracked by colour alone.",
        ),
    ] = AUTO,
    out: Annotated[Path, typer.Option(help="Folder of tables and images.")] = Path("out/gait"),
    preset: Preset = "",
    set_: Settings = [],  # noqa: B006 (typer copies it)
    video: Annotated[bool, typer.Option(help="Draw gait.webm, which takes longest.")] = True,
) -> None:
    """Track heads, hands and feet in a recording; write tables, pages and a video."""
    from deploy.exporters.motion_files import write_motion  # noqa: PLC0415
    from evaluation.gait.report import GaitReport, read_run  # noqa: PLC0415

    source = scenarios.resolve(recording) if scenarios.is_scenario(recording) else recording
    run = read_run(source, _box(person), preset, set_)
    report = GaitReport(run, out, video=video)
    try:
        with interruptible(f"The frames so far are in {out}."), progress() as on_progress:
            report.run(on_progress)
    finally:
        report.finish()
    for key in report.tables.people:
        if motion := report.tables.motion(key):
            write_motion(out, f"person_{key}", motion)
    _print_measures(report.tables)
    pages = [str(out / f"person_{person}.html") for person in report.tables.people]
    typer.echo(f"Wrote {out}; open {' or '.join(pages)}" if pages else f"Wrote {out}")


def _box(text: str) -> tuple[float, float, float, float] | None:
    if text == AUTO:
        return None
    if not BOX.fullmatch(text):
        raise ConfigError(
            f"--person {text!r:.80} is neither auto nor a box",
            "Write left,top,right,bottom in pixels of the first frame: --person 210,80,330,420",
        )
    left, top, right, bottom = (float(part) for part in text.split(","))
    if left >= right or top >= bottom:
        raise ConfigError(
            f"--person {text}: the box has no area", "Write left,top,right,bottom in this order."
        )
    return left, top, right, bottom


def _print_measures(tables: "GaitTables") -> None:
    if not tables.people:
        typer.echo("No person was tracked: tracks are confirmed in their third frame. For fewer")
        typer.echo("frames, or without detections, give a box: --person left,top,right,bottom")
        return
    columns = (">steps", ">step m", ">stride m", ">steps/min", ">m/s", ">asymmetry")
    table = plain_table("person", *columns)
    for person in tables.people:
        measures = tables.measures(person)
        numbers = (
            (measures.step_length_m, 2),
            (measures.stride_length_m, 2),
            (measures.cadence_per_min, 0),
            (measures.walking_speed_mps, 2),
            (measures.step_time_asymmetry, 2),
        )
        cells = ("" if value is None else f"{value:.{digits}f}" for value, digits in numbers)
        table.add_row(f"#{person}", str(measures.steps), *cells)
    print_table(table)
