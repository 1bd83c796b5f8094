"""Command `people4d tune`."""

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from common.extras import need
from deploy.cli.data.targets import Force, check_target
from deploy.cli.options import Preset, Settings
from deploy.cli.system.demo import DEMO
from deploy.cli.terminal import interruptible, progress
from people4d.errors import ConfigError

# Most modules are imported on use: compiled code takes a second to load.


def tune(
    recording: Annotated[
        str, typer.Argument(help="Recording with ground truth or annotations, or lab:SCENARIO.")
    ],
    minutes: Annotated[float, typer.Option(help="Duration of the search [min].")] = 10.0,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Annotations (people4d annotate) in place of other ground truth."
        ),
    ] = None,
    preset: Preset = "best",
    out: Annotated[Path, typer.Option(help="Preset to write if there is a gain.")] = Path(
        "tuned.toml"
    ),
    seed: Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Seed of the search.")] = 1,
    candidates: Annotated[
        int,
        typer.Option(
            min=0,
            help="Settings in each of the searches in place of --minutes, to repeat a result.",
        ),
    ] = 0,
    cache: Annotated[
        Path | None, typer.Option(help="Folder of detections; default: in your cache folder.")
    ] = None,
    force: Force = False,
    set_: Settings = [],  # noqa: B006 (typer copies it)
) -> None:
    """Search the tracker's settings for a scene; write a preset if they are better.

    The gain is measured in parts of the recording on which the settings were not searched. Settings
    that are worse on the shipped recording are not used.
    """
    need("people4d tune", "tune")
    from evaluation.cache import default_folder  # noqa: PLC0415
    from evaluation.methods import read_method  # noqa: PLC0415
    from evaluation.recordings.recordings import plan_recordings  # noqa: PLC0415
    from evaluation.report.csv_files import write_bytes  # noqa: PLC0415
    from evaluation.run.preparation import EvaluationPlan  # noqa: PLC0415
    from evaluation.tuning import TuningBudget, preset_text, tune_plan  # noqa: PLC0415

    check_target(out, None, force)
    if any(not one.startswith("camera.") for one in set_):
        raise ConfigError(
            "--set: expected settings of the camera only", "Put others into a --preset FILE.toml."
        )
    budget, folder = TuningBudget(minutes, candidates, seed), (cache or default_folder()).absolute()
    (found,) = plan_recordings([recording], [], "colour", folder)
    (shipped,) = plan_recordings([str(DEMO)], [], "colour", folder)
    plan = EvaluationPlan(
        methods=(read_method(preset, set_),),
        recordings=(replace(found, annotations=truth),),
        cache=folder,
        figures=False,
    )
    with interruptible("Nothing was written."), progress() as on_progress:
        result = tune_plan(plan, shipped, budget, on_progress)
    lines = [f"IDF1 [%] in parts on which it was not searched: {result.gain.sentence}."]
    lines += [f"{one.difference.figure.title}: {one.sentence}." for one in result.worse]
    lines.append(f"Candidates in each of the searches: {result.candidates}, seed {seed}.")
    typer.echo("\n".join(lines))
    if not result.is_better:
        typer.echo(f"No gain beyond the interval: no preset is written, keep {preset}.")
        return
    command = f"people4d {shlex.join(sys.argv[1:])}"
    write_bytes(out, preset_text(preset, result, [command, *lines]).encode())
    typer.echo(f"Wrote {out}. Use it: people4d up --preset {out}")
