"""Effect of each part beyond the source works: the preset `best`, and `best` less one part.

Films and detections are kept in the cache of `people4d evaluate`: the same command goes on.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.lib.table import markdown, write
from common.metrics.scores import Row, combine
from evaluation.cache import default_folder
from evaluation.methods import Method, read_method
from evaluation.pool import Pool
from evaluation.recordings.recordings import plan_recordings
from evaluation.run.preparation import EvaluationPlan, check_models, render_all, runs_of
from evaluation.run.run import EvaluationRun, RunScores, execute, score_run

SCENARIOS = (
    *("two_easy", "two_crossing", "three_easy", "three_crossing", "three_dense"),
    *("four_crossing", "four_dense"),
)
SCENES = ",".join(f"lab:{name}@51" for name in SCENARIOS)
FAITHFUL = "pose-strongsort-movenet"
STRONG = "tracker.strongsort3d"
# What is left out, and the settings that do so.
PARTS: dict[str, tuple[str, ...]] = {
    "surface to axis": ("detector.to_axis=false",),
    "position of the torso": ("detector.position=keypoints",),
    "measured covariance": (f"{STRONG}.noise=constant",),
    "joint orientation": ("detector.orientation.method=separate",),
    "weighted orientation": (
        "detector.orientation.method=separate",
        "detector.orientation.weighted=false",
        "tracker.yaw_filter.measured_sigma=false",
    ),
    "outliers and flips of yaw": ("tracker.yaw_filter.outlier_sigmas=inf",),
    "yaw from walking": ("tracker.yaw_filter.sigma_walk_rad=inf",),
    "occlusion": (f"{STRONG}.occlusion.enabled=false",),
    "contact": (f"{STRONG}.contact.enabled=false",),
    "identity": (f"{STRONG}.identity.enabled=false",),
}
COLUMNS = (
    ("position_rmse_across_m", "across m", "{:.3f}"),
    ("position_rmse_along_m", "along m", "{:.3f}"),
    ("velocity_rmse_across_mps", "velocity across m/s", "{:.3f}"),
    ("velocity_rmse_along_mps", "along m/s", "{:.3f}"),
    ("yaw_rmse_deg", "yaw deg", "{:.1f}"),
    ("yaw_correlation", "yaw correlation", "{:.3f}"),
    ("id_switches_per_min", "ID switches a min", "{:.2f}"),
    ("share_reidentified", "re-identified", "{:.1%}"),
    ("coverage", "coverage", "{:.1%}"),
)


def methods() -> list[Method]:
    """Return `best`, `best` less each part, and the method of [PIC4SeR] on the same model."""
    less = [
        replace(read_method("best", settings), name=f"- {part}") for part, settings in PARTS.items()
    ]
    return [read_method("best"), *less, read_method(FAITHFUL)]


def try_out(run_of_method: EvaluationRun) -> RunScores:
    """Return the figures of one trial."""
    return score_run(run_of_method, execute(run_of_method))


def rows(results: Sequence[RunScores]) -> list[list[str]]:
    """Return a line for each method: all its trials together, as if they were one recording."""
    most = max(result.people for result in results)
    lines = []
    for name in dict.fromkeys(result.method for result in results):
        own = [result for result in results if result.method == name]
        crowd = [result for result in own if result.people == most]
        row = combine(result.scores for result in own).row()
        busy = combine(result.scores for result in crowd).row()
        cells = [text(row, figure, form) for figure, _, form in COLUMNS]
        lines.append([name, *cells, text(busy, "id_switches_per_min", "{:.2f}")])
    return lines


def header(results: Sequence[RunScores]) -> list[str]:
    """Return the titles of the columns."""
    most = max(result.people for result in results)
    return ["method", *(title for _, title, _ in COLUMNS), f"ID switches a min, {most} people"]


def text(row: Row, figure: str, form: str) -> str:
    """Return a figure as text, "-" where there is none."""
    value = row[figure]
    return "-" if value is None else form.format(value)


def main() -> None:
    """Judge all methods on all scenes and write the table."""
    parser = argparse.ArgumentParser(description="What each part of the preset best is worth.")
    parser.add_argument("--scenes", default=SCENES, help="as of people4d evaluate --recordings")
    parser.add_argument("--fidelity", choices=("geometry", "depth", "colour"), default="colour")
    parser.add_argument("--seeds", default="", help="of scenarios that name none")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cache", type=Path, default=default_folder())
    parser.add_argument("--dry", action="store_true", help="print the table, do not write it")
    asked = parser.parse_args()
    seeds = [int(seed) for seed in asked.seeds.split(",") if seed]
    recordings = plan_recordings(
        asked.scenes.split(","), seeds, asked.fidelity, asked.cache.absolute()
    )
    plan = EvaluationPlan(
        tuple(methods()), tuple(recordings), asked.cache.absolute(), asked.jobs, figures=False
    )
    check_models(plan)
    render_all(plan, report_progress)
    with Pool(plan.jobs, report_progress) as pool:
        results = pool.do("tracking", try_out, runs_of(plan, pool))
    table = markdown(header(results), rows(results))
    if asked.dry:
        print(table)
        return
    names = ", ".join(take.name for take in recordings)
    note = (
        f"`best`, `best` less one part in each line, and [PIC4SeR]'s third method as it states it, "
        f"on {names} of the virtual lab ({asked.fidelity}). All scenes together, over all "
        f"frames in which a person is in view and at least 35 % of them is visible, measured or "
        f"predicted; re-identified are those who come back after two seconds or more."
    )
    write(__file__, "What each part beyond the source works is worth", note, table)


def report_progress(what: str, share: float) -> None:
    """Print how far it is."""
    print(f"{what} {share:.0%}", flush=True)


if __name__ == "__main__":
    main()
