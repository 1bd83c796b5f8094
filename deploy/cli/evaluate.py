"""people4d evaluate."""

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.console import Console
from rich.table import Table as RichTable

from deploy.cli.progress import can_draw_figures, cores, interruptible, progress
from people4d.errors import ConfigError
from services.presets import PRESETS

# Most modules are imported on use: compiled code takes a second to load.


if TYPE_CHECKING:
    from evaluation.report.tables import ReportTable


def evaluate(
    presets: Annotated[
        list[str],
        typer.Argument(
            metavar="PRESET...", help=f"Methods: {', '.join(PRESETS)}, or TOML files of that form."
        ),
    ],
    recordings: Annotated[
        list[str],
        typer.Option(
            metavar="SOURCE",
            help="Recording, ROS bag or folder with its truth, or lab:SCENARIO; several with "
            "commas between, or the option again.",
        ),
    ],
    seeds: Annotated[
        str, typer.Option(help="Seeds of every scenario, for example 1,2,3; else its own.")
    ] = "",
    fidelity: Annotated[
        Literal["geometry", "depth", "colour"],
        typer.Option(
            help="How much of a scenario is rendered. geometry: detections in place of frames."
        ),
    ] = "colour",
    out: Annotated[Path, typer.Option(help="Folder of the report.")] = Path("out/evaluation"),
    jobs: Annotated[
        int, typer.Option(min=0, help="Processes at once, one thread each; 0: one for each core.")
    ] = 0,
    cache: Annotated[
        Path | None,
        typer.Option(help="Folder of renderings and detections; else one in your cache folder."),
    ] = None,
    set_: Annotated[
        list[str],
        typer.Option("--set", metavar="SERVICE.FIELD=VALUE", help="A setting of all methods."),
    ] = [],  # noqa: B006 (typer copies it)
    visual_odometry: Annotated[
        bool,
        typer.Option("--visual-odometry", help="Motion of the base from images, not wheels."),
    ] = False,
    figures: Annotated[
        bool, typer.Option(help="Draw figures, if matplotlib is installed, the extra 'evaluate'.")
    ] = True,
) -> None:
    """Score methods on recordings with truth; the same metrics every time, on any machine."""
    from evaluation.cache import default_folder  # noqa: PLC0415
    from evaluation.evaluate import evaluate as do  # noqa: PLC0415
    from evaluation.evaluate import write  # noqa: PLC0415
    from evaluation.methods import read_methods  # noqa: PLC0415
    from evaluation.recordings.recordings import plan_recordings  # noqa: PLC0415
    from evaluation.run.preparation import EvaluationPlan  # noqa: PLC0415
    from services.visual_odometry.config import VisualOdometryConfig  # noqa: PLC0415

    if visual_odometry and fidelity == "geometry":
        raise ConfigError("--fidelity geometry has no images", "Render them: --fidelity colour.")
    figures = figures and can_draw_figures()
    folder = (cache or default_folder()).absolute()
    plan = EvaluationPlan(
        methods=tuple(read_methods(presets, set_)),
        recordings=tuple(plan_recordings(_sources(recordings), _seeds(seeds), fidelity, folder)),
        cache=folder,
        jobs=jobs or cores(),
        figures=figures,
        motion=VisualOdometryConfig() if visual_odometry else None,
    )
    hint = f"Renderings and detections are in {folder}: the same command continues."
    with interruptible(hint), progress() as on_progress:
        evaluation = do(plan, on_progress)
        page = write(plan, evaluation, out, f"people4d {shlex.join(sys.argv[1:])}")
    _show(evaluation.overview)
    typer.echo(f"Wrote {page}")


def _show(table: "ReportTable") -> None:
    shown = RichTable(title=table.title, title_justify="left", box=None, header_style="bold")
    shown.add_column("method")
    columns = zip(*((row.people, *row.cells) for row in table.rows), strict=True)
    titles = ("people", *(column.title for column in table.columns))
    for title, cells in zip(titles, columns, strict=True):
        shown.add_column(title, justify="right", min_width=max(map(len, cells)))
    for row in table.rows:
        shown.add_row(row.method, row.people, *row.cells, style="dim" if row.published else "")
    Console(highlight=False).print(shown)


def _sources(texts: list[str]) -> list[str]:
    """Split at commas, but for a path that has one in its name."""
    names = ([text] if Path(text).exists() else text.split(",") for text in texts)
    return [name.strip() for part in names for name in part if name.strip()]


def _seeds(text: str) -> list[int]:
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if not all(part.isdecimal() for part in parts):
        raise ConfigError(f"--seeds: expected whole numbers with commas between, got {text!r}")
    return [int(part) for part in parts]
