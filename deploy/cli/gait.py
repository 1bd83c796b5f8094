"""people4d gait."""

import importlib.util
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from deploy.cli.progress import interruptible, progress
from lab import scenario as scenarios
from people4d.errors import ConfigError
from services.presets import PRESETS

# What is needed to do it is imported on use: compiled code takes a second to load.

if TYPE_CHECKING:
    from evaluation.gait.log import Log

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
            help="auto: everybody, found and tracked. A box in the first frame, in pixels: whoever "
            "is in it, followed by colours alone.",
        ),
    ] = AUTO,
    out: Annotated[Path, typer.Option(help="Folder of tables and pictures.")] = Path("out/gait"),
    preset: Annotated[
        str, typer.Option(help=f"Method with its settings: {', '.join(PRESETS)}, or a TOML file.")
    ] = "",
    set_: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="SERVICE.FIELD=VALUE",
            help="Any other setting: gait.cascade.depth.feature=spin, camera.max_frames=100.",
        ),
    ] = [],  # noqa: B006 (typer copies it)
    video: Annotated[bool, typer.Option(help="Draw gait.webm, which takes longest.")] = True,
    figures: Annotated[
        bool, typer.Option(help="Draw figures; that takes matplotlib, the extra 'evaluate'.")
    ] = True,
) -> None:
    """Follow heads, hands and feet in a recording; write tables, plots and a video."""
    from evaluation.gait.report import Report, read_wish  # noqa: PLC0415

    if figures and importlib.util.find_spec("matplotlib") is None:
        raise ConfigError(
            "figures are drawn with matplotlib, which is not installed",
            "Install it with: pip install 'people4d[evaluate]', or add --no-figures.",
        )
    source = scenarios.resolve(recording) if scenarios.is_scenario(recording) else recording
    request = read_wish(source, _box(person), preset, set_)
    report = Report(request, out, video=video, figures=figures)
    try:
        with interruptible(f"What came before is in {out}."), progress() as told:
            report.run(told)
    finally:
        report.finish()
    _show(report.log)
    typer.echo(f"Wrote {out}")


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


def _show(log: "Log") -> None:
    if not log.people:
        typer.echo("Nobody was followed: people are told from their third frame on. In less frames")
        typer.echo("or where nobody is detected say who: --person left,top,right,bottom")
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("person")
    for title in ("steps", "step m", "stride m", "steps/min", "m/s", "asymmetry"):
        table.add_column(title, justify="right")
    for person in log.people:
        told = log.measures(person)
        numbers = (
            (told.step_length_m, 2),
            (told.stride_length_m, 2),
            (told.cadence_per_min, 0),
            (told.walking_speed_mps, 2),
            (told.step_time_asymmetry, 2),
        )
        cells = ("" if value is None else f"{value:.{digits}f}" for value, digits in numbers)
        table.add_row(f"#{person}", str(told.steps), *cells)
    Console(highlight=False).print(table)
