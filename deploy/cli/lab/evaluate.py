"""Command `people4d evaluate`."""

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from deploy.cli.options import Fidelity, Figures, Jobs, Settings, VisualOdometry
from deploy.cli.terminal import (
    can_draw_figures,
    cores,
    interruptible,
    plain_table,
    print_table,
    progress,
    shown,
)
from evaluation.datasets.registry import DATASETS, find_dataset
from people4d.errors import ConfigError
from services.presets import PRESETS

# Most modules are imported on use: compiled code takes a second to load.

METHODS = ", ".join(name for name in PRESETS if not name.startswith("gait-"))

if TYPE_CHECKING:
    from evaluation.recordings.recordings import EvaluationRecording
    from evaluation.report.tables import ReportTable


def evaluate(
    presets: Annotated[
        list[str],
        typer.Argument(
            metavar="PRESET...",
            help=f"Methods: {METHODS}, or TOML files of that form. Data sets have a default one.",
            show_default=False,
        ),
    ] = [],  # noqa: B006 (typer copies it)
    recordings: Annotated[
        list[str],
        typer.Option(
            metavar="SOURCE",
            help="Recording, ROS bag or folder with ground truth, or lab:SCENARIO; several "
            "separated by commas, or by repeating the option.",
            show_default=False,
        ),
    ] = [],  # noqa: B006 (typer copies it)
    dataset: Annotated[
        tuple[str, Path] | None,
        typer.Option(
            metavar="NAME FOLDER",
            help=f"Data set of another group in place of recordings: {', '.join(DATASETS)}.",
            show_default=False,
        ),
    ] = None,
    truth: Annotated[
        list[Path],
        typer.Option(
            metavar="FILE",
            help="Annotations (people4d annotate) in place of other ground truth; repeat the "
            "option, one file for each recording.",
            show_default=False,
        ),
    ] = [],  # noqa: B006 (typer copies it)
    seeds: Annotated[
        str, typer.Option(help="Seeds of every scenario, for example 1,2,3; default: its own.")
    ] = "",
    fidelity: Fidelity = "colour",
    out: Annotated[Path, typer.Option(help="Folder of the report.")] = Path("out/evaluation"),
    jobs: Jobs = 0,
    cache: Annotated[
        Path | None,
        typer.Option(help="Folder of renderings and detections; default: in your cache folder."),
    ] = None,
    set_: Settings = [],  # noqa: B006 (typer copies it)
    visual_odometry: VisualOdometry = False,
    figures: Figures = True,
) -> None:
    """Score methods on recordings with ground truth; the metrics are reproducible."""
    from evaluation.cache import default_folder  # noqa: PLC0415
    from evaluation.evaluate import evaluate as do  # noqa: PLC0415
    from evaluation.methods import read_methods  # noqa: PLC0415
    from evaluation.recordings.recordings import plan_recordings  # noqa: PLC0415
    from evaluation.report.page import write  # noqa: PLC0415
    from evaluation.run.preparation import EvaluationPlan, warnings_of  # noqa: PLC0415
    from services.visual_odometry.config import VisualOdometryConfig  # noqa: PLC0415

    if visual_odometry and fidelity == "geometry":
        raise ConfigError("--fidelity geometry has no images", "Render them: --fidelity colour.")
    folder = (cache or default_folder()).absolute()
    if bool(recordings) == bool(dataset):
        raise ConfigError("expected either --recordings or --dataset", "See --help.")
    if dataset and truth:
        raise ConfigError("--truth is for --recordings", "A data set has its own ground truth.")
    if dataset:
        if seeds or visual_odometry or fidelity != "colour":
            raise ConfigError("--dataset takes no --seeds, --fidelity or --visual-odometry")
        _evaluate_dataset(*dataset, presets, set_, DatasetOutput(out, folder, jobs or cores()))
        return
    if not presets:
        raise ConfigError("expected a preset, got none", f"Choose {METHODS}.")
    figures = figures and can_draw_figures()
    plan = EvaluationPlan(
        methods=tuple(read_methods(presets, set_)),
        recordings=_annotated(
            plan_recordings(_sources(recordings), _seeds(seeds), fidelity, folder), truth
        ),
        cache=folder,
        jobs=jobs or cores(),
        figures=figures,
        motion=VisualOdometryConfig() if visual_odometry else None,
    )
    for warning in warnings_of(plan):
        typer.echo(f"Warning: {warning}", err=True)
    hint = f"Renderings and detections are in {folder}: the same command continues."
    with interruptible(hint), progress() as on_progress:
        evaluation = do(plan, on_progress)
        page = write(plan, evaluation, out, f"people4d {shlex.join(sys.argv[1:])}")
    _show(evaluation.overview)
    typer.echo(f"Wrote {page}")


class DatasetOutput(NamedTuple):
    """Folders and processes of an evaluation."""

    out: Path
    cache: Path
    jobs: int


def _evaluate_dataset(
    name: str, folder: Path, presets: list[str], settings: list[str], output: DatasetOutput
) -> None:
    """Print the figures of a data set, and write them with the files of its server."""
    from evaluation.datasets.run import DatasetPlan, evaluate_dataset  # noqa: PLC0415

    dataset = find_dataset(name)
    methods = dataset.methods(presets, settings)
    plan = DatasetPlan(dataset, folder, methods, *output)
    hint = "The same command starts from the beginning, with the detections made so far."
    with interruptible(hint), progress() as on_progress:
        lines = evaluate_dataset(plan, on_progress)
    columns = [f">{column}" for column in dataset.columns]
    drawn = plain_table("method", "sequence", *columns, title=f"{dataset.title}: {dataset.metric}")
    for method, sequence, row in lines:
        cells = [_figure(row.get(column)) for column in dataset.columns]
        drawn.add_row(shown(method), shown(sequence), *cells)
    print_table(drawn)
    typer.echo(f"Wrote {output.out / 'scores.csv'}{' and submission' if dataset.server else ''}")


def _figure(value: float | None) -> str:
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else f"{value:.3f}"


def _show(table: "ReportTable") -> None:
    titles = [f">{column.title}" for column in table.columns]
    drawn = plain_table("method", ">people", *titles, title=shown(table.title), no_wrap=True)
    for row in table.rows:
        drawn.add_row(
            shown(row.method), row.people, *row.cells, style="dim" if row.published else ""
        )
    print_table(drawn)


def _annotated(
    recordings: "list[EvaluationRecording]", files: list[Path]
) -> "tuple[EvaluationRecording, ...]":
    from evaluation.annotations.marks import read_annotations  # noqa: PLC0415

    if not files:
        return tuple(recordings)
    if len(files) != len(recordings):
        raise ConfigError(
            f"--truth: expected one file for each of {len(recordings)} recordings, got {len(files)}"
        )
    for file in files:
        read_annotations(file)  # wrong files are refused before detections are made
    pairs = zip(recordings, files, strict=True)
    return tuple(replace(recording, annotations=file) for recording, file in pairs)


def _sources(texts: list[str]) -> list[str]:
    """Split at commas, except in existing paths."""
    names = ([text] if Path(text).exists() else text.split(",") for text in texts)
    return [name.strip() for part in names for name in part if name.strip()]


def _seeds(text: str) -> list[int]:
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if not all(part.isdecimal() for part in parts):
        raise ConfigError(f"--seeds: expected comma-separated whole numbers, got {text!r}")
    return [int(part) for part in parts]
