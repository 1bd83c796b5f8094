"""Effect of each part beyond the source works: the preset `best`, and `best` less one part.

On random scenes of the lab (lab_people.md) and, beside them, on real people marked by hand
(real_people.md); their recording is not part of the repository, `--shared` names the folder that
holds it. Renderings and detections stay in the cache of `people4d evaluate`: the same command goes
on.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.lab_people import COLUMNS, GROUPS, TESTING, report_progress, text, try_out
from benchmarks.lib.marked_recording import MarkedRecording, marked, run
from benchmarks.lib.table import markdown, write
from benchmarks.real_people import HALVES, MARKS, ROOT
from common.metrics.scores import combine
from evaluation.cache import default_folder
from evaluation.methods import Method, read_method
from evaluation.pool import Pool
from evaluation.recordings.hand_annotations import FPS, crossing_camera
from evaluation.recordings.hand_marks import read_frames
from evaluation.recordings.mark_scores import MarkScores, figures
from evaluation.recordings.recordings import plan_recordings
from evaluation.run.preparation import EvaluationPlan, check_models, render_all, runs_of
from evaluation.run.run import RunScores

SCENES = ",".join(f"lab:{scene}" for scene in GROUPS.values())
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
    "limit of re-identification": (f"{STRONG}.identity.match_max=0.25",),
    "life cycle by hits": (f"{STRONG}.lifetime=streak", f"{STRONG}.n_init=3"),
    "standing model": (f"{STRONG}.imm.enabled=false",),
    "acceleration": (f"{STRONG}.sigma_acceleration_mps2=0.5",),
}


def methods(tracker_alone: bool) -> list[Method]:
    """Return `best`, `best` less each part, and the method of [PIC4SeR] on the same model.

    Parts of the tracker alone leave the detections as they are.
    """
    less = [
        replace(read_method("best", settings), name=f"- {part}")
        for part, settings in PARTS.items()
        if not tracker_alone or all(one.startswith("tracker.") for one in settings)
    ]
    return [read_method("best"), *less, *([] if tracker_alone else [read_method(FAITHFUL)])]


REAL_HEADER = (
    *(f"real, {half}: right identity" for half in HALVES),
    *("real: IDF1 %", "position > 0.5 m off", "facing within 45 deg"),
)


def real_cells(method: Method, recording: MarkedRecording, cache: Path) -> list[str]:
    """Return the figures of a method on real people; identities of those less than half hidden."""
    tracks = recording.hypotheses(run(method, recording.camera, cache))
    scores = MarkScores(recording.truth, tracks, FPS)
    visible = [o for o in scores.outcomes if o.truth.mark.visibility != "mostly"]
    every = figures(scores.outcomes)
    owned = [figures([o for o in visible if o.frame in half]).owned for half in HALVES.values()]
    idf1, _ = scores.idf1_hota(range(len(tracks)))
    return [*map(str, owned), f"{100 * idf1:.1f}", str(every.far), str(every.facing)]


def rows(results: Sequence[RunScores], real: Mapping[str, Sequence[str]]) -> list[list[str]]:
    """Return a line for each method: all its trials together, as if they were one recording."""
    most = max(result.people for result in results)
    lines = []
    for name in dict.fromkeys(result.method for result in results):
        own = [result for result in results if result.method == name]
        crowd = [result for result in own if result.people == most]
        row = combine(result.scores for result in own).row()
        busy = combine(result.scores for result in crowd).row()
        cells = [text(row, figure, form) for figure, _, form in COLUMNS]
        cells.append(text(busy, "id_switches_per_min", "{:.2f}"))
        lines.append([name, *cells, *real[name]])
    return lines


def header(results: Sequence[RunScores]) -> list[str]:
    """Return the titles of the columns."""
    most = max(result.people for result in results)
    lab = (title for _, title, _ in COLUMNS)
    return ["method", *lab, f"ID switches a min, {most} people", *REAL_HEADER]


def main() -> None:
    """Judge all methods on all scenes and write the table."""
    parser = argparse.ArgumentParser(description="What each part of the preset best is worth.")
    parser.add_argument("--scenes", default=SCENES, help="as of people4d evaluate --recordings")
    parser.add_argument("--fidelity", choices=("geometry", "depth", "colour"), default="colour")
    parser.add_argument("--seeds", default=str(TESTING[0]), help="of scenarios that name none")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cache", type=Path, default=default_folder())
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    parser.add_argument("--tracker", action="store_true", help="parts of the tracker alone")
    parser.add_argument("--dry", action="store_true", help="print the table, do not write it")
    asked = parser.parse_args()
    seeds = [int(seed) for seed in asked.seeds.split(",") if seed]
    recordings = plan_recordings(
        asked.scenes.split(","), seeds, asked.fidelity, asked.cache.absolute()
    )
    compared = methods(asked.tracker)
    plan = EvaluationPlan(
        tuple(compared), tuple(recordings), asked.cache.absolute(), asked.jobs, figures=False
    )
    check_models(plan)
    render_all(plan, report_progress)
    with Pool(plan.jobs, report_progress) as pool:
        results = pool.do("tracking", try_out, runs_of(plan, pool))
    real_people, _ = marked(crossing_camera(asked.shared), read_frames(MARKS / "filinha.json"))
    real = {one.name: real_cells(one, real_people, plan.cache) for one in compared}
    table = markdown(header(results), rows(results, real))
    if asked.dry:
        print(table)
        return
    names = ", ".join(take.name for take in recordings)
    note = (
        f"`best`, and less one part {'of the tracker ' * asked.tracker}in each line"
        f"{'' if asked.tracker else ', and the third method of [PIC4SeR] as it states it'}, "
        f"on {names} of the virtual lab ({asked.fidelity}). All scenes together, over all "
        f"frames in which a person is in view and at least 35 % of them is visible, measured or "
        f"predicted; re-identified are those who come back after two seconds or more. Real: six "
        f"people who hide each other, see real_people.md; right identity of those less than half "
        f"hidden, by half of the recording."
    )
    write(__file__, "What each part beyond the source works is worth", note, table)


if __name__ == "__main__":
    main()
