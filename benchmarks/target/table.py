"""The chosen person: wrong locks, availability and returns, beside identities of trackers.

Every person is chosen in turn by the first track that is beyond doubt. Rendered scenes and their
detections stay in the cache; rendering takes minutes a scene.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.gait.drawn_scenes import drawn_scenes
from benchmarks.lib.marks.crossing import FPS, MOUNT_RPY_RAD, MOUNT_XYZ_M
from benchmarks.lib.table import markdown, write
from benchmarks.target.peers import peer_rules
from benchmarks.target.play import (
    FollowedFrame,
    Rule,
    by_service,
    by_track,
    choices,
    follow,
    played_frames,
    work_ms,
)
from benchmarks.target.scenes import RENDERED, SEEDS, crop_banks, long_scene, with_crops
from benchmarks.target.score import HEADER, score
from evaluation.methods import Method, read_method
from evaluation.pool import Pool
from evaluation.recordings.recordings import EvaluationRecording, plan_recordings
from evaluation.run.preparation import EvaluationPlan, check_models, render_all, runs_of
from evaluation.run.run import EvaluationRun, execute
from services.target.config import TargetConfig

FILINHA = Path(__file__).parents[1] / "real_people_marks" / "filinha.json"  # annotations
CURVE = (0.5, 0.8, 0.9, 0.95, 0.99)  # minimum probabilities of a lock
USUAL = TargetConfig().probability_min
RULES: dict[str, Rule] = {
    "service": by_service(USUAL),
    "identity of the track": by_track,
    **{f"service, {p}": by_service(p) for p in CURVE if p != USUAL},
}
NOTE = """
Each person is chosen in turn; the service restarts every minute. `Wrong`: the locked track is
within 0.6 m of another person and not of the chosen one; `stray`: of no person. `Available`: share
of the frames with the person visible (35 % or more, in view) in which it is locked. `Re-acquired`:
returns after an absence of 1 s or more, visible for 1.5 s, that are locked by then. Rendered: four
people, 30 s, the whole pipeline. Long scenes: 150 s, detections from geometry, three to six people,
absences up to a minute, every other scene from a driving robot, crops of four rendered people;
others have no crops and are not chosen. Unlike: own clothes; alike: all in dark clothes. Filinha:
recording of six people crossing, with annotations, the whole pipeline. ByteTrack and BoT-SORT:
their identities on the same boxes, own settings, no appearance. No constant was
chosen on these seeds or this recording.
""".strip().replace("\n", " ")

PEOPLE_MIN = 3  # minimum number of tracks of the frames whose work is measured

Played = Mapping[str, list[list[FollowedFrame]]]  # frames of each chosen person, by rule


@dataclass(frozen=True)
class GroupRun:
    """One scene of a group."""

    group: str
    run: EvaluationRun
    peers: Sequence[str]  # interpreters with other packages


def runs_by_group(split: str, asked: argparse.Namespace, pool: Pool) -> list[GroupRun]:
    """Render and detect all scenes of a split."""
    cache, jobs, other = asked.cache.absolute(), asked.jobs, asked.other
    seeds, rendered = SEEDS[split]
    plans = {
        f"rendered, {'unlike' if outfit == 'own' else 'alike'}": plan_recordings(
            [RENDERED + outfit], numbers, "colour", cache
        )
        for outfit, numbers in rendered.items()
    }
    runs = {name: _runs(recordings, cache, jobs, pool) for name, recordings in plans.items()}
    banks = {
        name.removeprefix("rendered, "): [bank for run in found for bank in crop_banks(run)]
        for name, found in runs.items()
    }
    kinds = list(banks)
    for run in _runs([long_scene(seed, cache) for seed in seeds[: asked.long]], cache, jobs, pool):
        seed = run.recording.seed or 0
        kind = kinds[seed // 2 % 2]
        first = 4 * (seed // 4) % max(1, len(banks[kind]) - 6)
        runs.setdefault(f"long, {kind}", []).append(with_crops(run, banks[kind][first:], cache))
    if other and split == "judging":
        paths = [str(p) for name, _ in drawn_scenes() if (p := other.absolute() / name).exists()]
        found = plan_recordings(paths, (), "colour", cache)
        runs["second simulator"] = _runs(found, cache, jobs, pool)
    if split == "judging":
        runs["filinha"] = [_filinha_run(asked, pool)]
    return [GroupRun(name, run, asked.peers) for name, found in runs.items() for run in found]


def _runs(
    recordings: Sequence[EvaluationRecording],
    cache: Path,
    jobs: int,
    pool: Pool,
    method: Method | None = None,
) -> list[EvaluationRun]:
    used = method or read_method("best")
    plan = EvaluationPlan((used,), tuple(recordings), cache, jobs, figures=False)
    check_models(plan)
    render_all(plan, report_progress)
    return runs_of(plan, pool)


def _filinha_run(asked: argparse.Namespace, pool: Pool) -> EvaluationRun:
    """Return the run of the annotated recording of real people."""
    cache, folder = asked.cache.absolute(), asked.shared.absolute() / "data" / "rgbd" / "filinha"
    recordings = plan_recordings([str(folder)], (), "colour", cache)
    settings = (
        f"camera.options.fps={FPS}",
        f"camera.mount_xyz_m={list(MOUNT_XYZ_M)}",
        f"camera.mount_rpy_rad={list(MOUNT_RPY_RAD)}",
    )
    annotated = [replace(one, annotations=FILINHA) for one in recordings]
    (run,) = _runs(annotated, cache, asked.jobs, pool, read_method("best", settings))
    return run


def play(one: GroupRun) -> tuple[Played, list[float]]:
    """Return the frames of each chosen person of a scene, by rule, and the service's work [ms]."""
    frames = played_frames(one.run, execute(one.run))
    people, rules = choices(frames), RULES | peer_rules(one.peers, frames)
    played = {
        name: [follow(frames, choice, rule) for choice in people] for name, rule in rules.items()
    }
    return played, [ms for choice in people for ms in work_ms(frames, choice, PEOPLE_MIN)]


def report_progress(stage: str, share: float) -> None:
    """Print the progress of a stage."""
    print(f"{stage} {share:.0%}", flush=True)


def tables(scenes: Sequence[GroupRun], played: Sequence[Played]) -> list[str]:
    """Return the table of all groups, and the curve over the threshold."""
    groups = list(dict.fromkeys(one.group for one in scenes))

    def people(group: str, rule: str) -> list[list[FollowedFrame]]:
        pairs = zip(scenes, played, strict=True)
        return [frames for scene, one in pairs if scene.group == group for frames in one[rule]]

    rules = [rule for rule in played[0] if not rule.startswith("service,")]
    rows = [[g, *score(people(g, rule)).row(rule)] for g in groups for rule in rules]
    curve = []
    for p in CURVE:
        rule = "service" if p == USUAL else f"service, {p}"
        everyone = [frames for group in groups for frames in people(group, rule)]
        curve.append(score(everyone).row(f"{p}"))
    return [
        markdown(("scenes", *HEADER), rows),
        "## All scenes, by the minimum probability of a lock",
        markdown(("probability_min", *HEADER[1:]), curve),
    ]


def main() -> None:
    """Render, track, follow and write the tables."""
    parser = options.parser(__doc__, "shared", "jobs", "cache", "dry")
    parser.add_argument("--other", type=Path, help="folder of the second simulator's scenes")
    parser.add_argument("--peers", nargs="*", default=[], help="interpreters with other packages")
    parser.add_argument("--long", type=int, default=6, help="number of long scenes")
    parser.add_argument("--tuning", action="store_true", help="tuning seeds; nothing is written")
    asked = parser.parse_args()
    split = "tuning" if asked.tuning else "judging"
    with Pool(asked.jobs, report_progress) as pool:
        scenes = runs_by_group(split, asked, pool)
        played = pool.do("following", play, scenes)
    times_ms = [ms for _, scene_ms in played for ms in scene_ms]
    median_ms, most_ms = np.percentile(times_ms, (50, 99))
    cost = (
        f"Own work of the service with three tracks or more: median {median_ms:.2f} ms a frame, "
        f"p99 {most_ms:.2f} ms (thread time, {len(times_ms)} frames)."
    )
    text = [*tables(scenes, [rules for rules, _ in played]), cost]
    script = str(Path(__file__).parent)
    write(script, "The chosen person", NOTE, *text, dry=asked.dry or asked.tuning)
