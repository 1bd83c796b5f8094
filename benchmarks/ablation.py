"""Effect of each part beyond the source works: `best`, and `best` without one part.

Differences have 95 % intervals (paired bootstrap) over scenes, and over events of annotated real
people: a person during two seconds, in all augmentations of the recording. The tuning split served
to choose constants, the test split nothing: `--other` names the folder of the second simulator's
scenes (`python -m benchmarks.gait_scenes SIMULATOR FOLDER --test`), without which it lacks them.
Renderings and detections stay in the cache.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.lib import options
from benchmarks.lib.ablation.calibration import calibration_tables
from benchmarks.lib.ablation.parts import DELETED, PARTS, Part
from benchmarks.lib.gait.drawn_scenes import drawn_scenes
from benchmarks.lib.marks.crossing import crossing_camera
from benchmarks.lib.marks.methods import DEFAULT, HALVES, MARKS, variants
from benchmarks.lib.marks.recording import MarkedRecording, marked
from benchmarks.lib.marks.scores import MarkOutcome, figures
from benchmarks.lib.marks.variations import IMAGES, Cache, VariedDetections, detect, vary
from benchmarks.lib.table import markdown, write
from benchmarks.real_variations import VariationScores, score_detected
from common.metrics.intervals import Difference, PooledFigure, compare, pool
from evaluation.annotations.marks import read_frames
from evaluation.methods import Method, read_method
from evaluation.pool import Pool
from evaluation.recordings.recordings import EvaluationRecording, plan_recordings
from evaluation.run.preparation import EvaluationPlan, check_models, render_all, runs_of
from evaluation.run.run import EvaluationRun, RunScores, execute, score_run
from people4d.messages import F64
from services.camera.source import SourceFrame

SIMULATED = (
    PooledFigure("position m", root=True),
    PooledFigure("velocity m/s", root=True),
    PooledFigure("yaw deg", "{:.1f}", root=True),
    PooledFigure("ID switches a min", "{:.2f}"),
    PooledFigure("coverage %", "{:.1f}", 100.0, higher_is_better=True),
    PooledFigure("IDF1 %", "{:.1f}", 100.0, higher_is_better=True),
    PooledFigure("false tracks s/min", "{:.2f}"),
)
REAL = (
    PooledFigure("identity %", "{:.1f}", 100.0, higher_is_better=True),
    PooledFigure("facing %", "{:.1f}", 100.0, higher_is_better=True),
    PooledFigure("> 0.5 m off %", "{:.1f}", 100.0),
)
DETECTORS = {"MoveNet": DEFAULT, "YOLO": "YOLOv8n-pose, OSNet"}
EVENT_FRAMES = 20  # number of frames of an event: two seconds
TUNING_SEEDS, TEST_SEEDS = range(900, 905), range(906, 1000)  # seeds of lab scenes
SIZE = "duration_s=12&width=320&height=240"
LAB_GROUPS = (
    f"random?people=2&{SIZE}",
    f"random?people=4&{SIZE}",
    f"random?people=6&outfit=dark&{SIZE}",
    f"random?people=2&plain=true&depth_sensor=d435i&outfit=own&{SIZE}",
)
SPLITS = dict(zip(("tuning", "test"), HALVES.values(), strict=True))  # frames of real people
NOTE = """
`best`, and the difference without one part, with its 95 % interval from a paired bootstrap over
scenes, or over events of annotated real people (a person during two seconds, in all augmentations
of real_variations.md; identity of people at least half visible). Bold: the interval does not hold
0. With ten figures a part, one in four parts has such an interval on the side of worse values by
chance. The second simulator's scenes have seeds 7100 to 7135, written down before their first run.
The lab's test seeds begin at 906, its tuning seeds at 900. The tuning split of real people is the
first half of the recording, the test split the second. `False tracks`: seconds of tracks on no
person in view.
""".strip().replace("\n", " ")
Units = dict[str, F64]  # sums of each method, NxFx2 for N scenes or events


def report_progress(stage: str, share: float) -> None:
    """Print the progress of a stage."""
    print(f"{stage} {share:.0%}", flush=True)


def score_scene(run: EvaluationRun) -> RunScores:
    """Return the metrics of one method on one scene."""
    return score_run(run, execute(run))


def scene_sums(run: RunScores) -> F64:
    """Return numerator and denominator of each SIMULATED metric in one scene."""
    scores, errors = run.scores, run.scores.pose
    minutes = scores.lifetimes.duration_s / 60
    identity, lifetimes = scores.identity, scores.lifetimes
    false_s = scores.clear.false_alarms * scores.lifetimes.duration_s / max(1, run.frames)
    return np.array(
        [
            _squares(errors.position_m),
            _squares(errors.velocity_mps),
            _squares(np.degrees(errors.yaw_error_rad)[:, None]),
            (scores.clear.id_switches, minutes),
            (lifetimes.tracked, lifetimes.truths),
            (2 * identity.idtp, 2 * identity.idtp + identity.idfp + identity.idfn),
            (false_s, minutes),
        ],
        np.float64,
    )


def _squares(errors: F64) -> tuple[float, float]:
    known = errors[~np.isnan(errors).any(axis=1)]
    return float((known**2).sum()), float(len(known))


def event_sums(results: Sequence[VariationScores], frames: range) -> F64:
    """Return part and total of each figure of REAL in each event of some frames."""
    events: dict[tuple[str, int], F64] = {}
    for one in results:
        for outcome in one.outcomes(frames):
            key = outcome.truth.mark.person, one.frames[outcome.frame] // EVENT_FRAMES
            sums = _outcome_sums(outcome, forward=not one.order.reversed)
            events[key] = events.get(key, np.zeros_like(sums)) + sums
    return np.array([events[key] for key in sorted(events)])


def _outcome_sums(outcome: MarkOutcome, *, forward: bool) -> F64:
    shares = figures([outcome])
    shown = outcome.truth.mark.hidden != "mostly"
    counted = ((shares.owned, shown), (shares.facing, forward), (shares.far, True))
    return np.array([(share.part * use, share.total * use) for share, use in counted], np.float64)


@dataclass(frozen=True)
class RealPeople:
    """A recording in augmentations, with the detections computed so far."""

    recording: MarkedRecording
    images: Sequence[SourceFrame]
    shared: Path
    networks: dict[str, list[Cache]] = field(default_factory=dict)
    found: dict[bytes, list[VariedDetections]] = field(default_factory=dict)

    def results(self, detector: str, settings: Sequence[str]) -> list[VariationScores]:
        """Return the scores of `best` with a detector and settings in all augmentations."""
        known = {one.name: one for one in variants(self.shared)}
        method = read_method("best", (*known[DETECTORS[detector]].settings, *settings))
        key = msgspec.json.encode((method.detector, method.reid))
        if key not in self.found:
            self.found[key] = self._detect(method)
        return [
            one
            for variation, detections in zip(IMAGES, self.found[key], strict=True)
            for one in score_detected(method, self.recording, variation, detections)
        ]

    def _detect(self, method: Method) -> list[VariedDetections]:
        empty: list[Cache] = [{} for _ in IMAGES]
        caches = self.networks.setdefault(method.detector.model, empty)
        return [
            detect(method, vary(self.recording, variation).view, self.images, variation, cache)
            for variation, cache in zip(IMAGES, caches, strict=True)
        ]


def recordings(
    other: Path | None, lab_scenes: int, cache: Path
) -> dict[tuple[str, str], list[EvaluationRecording]]:
    """Return the simulated scenes by split and simulator."""
    found: dict[tuple[str, str], list[EvaluationRecording]] = {}
    if other:
        paths = [other.absolute() / name for name, _ in drawn_scenes()]
        names = [str(path) for path in paths if path.exists()]
        found["test", "second simulator"] = plan_recordings(names, (), "colour", cache)
    if lab_scenes:
        names = [f"lab:{group}" for group in LAB_GROUPS]
        for split, seeds in (("test", TEST_SEEDS), ("tuning", TUNING_SEEDS)):
            found[split, "lab"] = plan_recordings(names, seeds[:lab_scenes], "colour", cache)
    return found


def methods(parts: Mapping[str, Part]) -> list[Method]:
    """Return `best`, and `best` without each part."""
    without = [replace(read_method("best", p.settings), name=name) for name, p in parts.items()]
    return [read_method("best"), *without]


def simulated_units(
    scenes: Sequence[EvaluationRecording], parts: Mapping[str, Part], cache: Path, jobs: int
) -> Units:
    """Track all scenes with all methods."""
    plan = EvaluationPlan(tuple(methods(parts)), tuple(scenes), cache, jobs, figures=False)
    check_models(plan)
    render_all(plan, report_progress)
    with Pool(jobs, report_progress) as pool_:
        results = pool_.do("tracking", score_scene, runs_of(plan, pool_))
    names = [method.name for method in plan.methods]
    return {n: np.array([scene_sums(one) for one in results if one.method == n]) for n in names}


def real_units(people: RealPeople, parts: Mapping[str, Part]) -> dict[tuple[str, str], Units]:
    """Track real people with all methods, by split and detector."""
    found: dict[tuple[str, str], Units] = {(s, d): {} for s in SPLITS for d in DETECTORS}
    for k, name in enumerate(("best", *parts)):
        report_progress("real people", k / (len(parts) + 1))
        for detector in DETECTORS:
            results = people.results(detector, parts[name].settings if name in parts else ())
            for split, frames in SPLITS.items():
                found[split, detector][name] = event_sums(results, frames)
    return found


def table(units: Units, of: tuple[PooledFigure, ...]) -> str:
    """Return `best`, and the differences without each part: intervals, or 0 if nothing differs."""
    best = pool(units["best"].sum(axis=0), of).tolist()
    rows = [["best", *(figure.form.format(x) for figure, x in zip(of, best, strict=True))]]
    for name, differences in _differences(units, of):
        cells = [text if re.search("[1-9]", text := str(one)) else "0" for one in differences]
        rows.append([f"without {name}", *cells])
    return markdown(("method", *(figure.title for figure in of)), rows)


def _differences(
    units: Units, of: tuple[PooledFigure, ...]
) -> Iterator[tuple[str, list[Difference]]]:
    for name, sums in units.items():
        if name != "best":
            yield name, compare(sums, units["best"], of)


def verdicts(
    parts: Mapping[str, Part], test: Mapping[str, tuple[Units, tuple[PooledFigure, ...]]]
) -> str:
    """Return a verdict on each part, from the figures of the test split."""
    worse: dict[str, list[str]] = {name: [] for name in parts}
    better: dict[str, list[str]] = {name: [] for name in parts}
    for where, (units, of) in test.items():
        for name, differences in _differences(units, of):
            worse[name] += [f"{d.figure.title} ({where})" for d in differences if d.is_worse]
            better[name] += [f"{d.figure.title} ({where})" for d in differences if d.is_better]
    rows = []
    for name, part in parts.items():
        reason = f"kept, because without it worse: {', '.join(worse[name])}"
        published = f"published method: {part.source}" if part.source else "no figure is worse"
        rows.append([name, reason if worse[name] else published, ", ".join(better[name]) or "-"])
    return markdown(("part", "verdict", "without it better"), rows)


def deleted() -> str:
    """Return the rules that are deleted, each with commit and reason."""
    rows = [[rule, commit, why] for commit, rules in DELETED.items() for rule, why in rules]
    return markdown(("rule", "deleted by", "because"), rows)


def main() -> None:
    """Track everything with all methods and write the tables."""
    parser = options.parser(__doc__, "shared", "jobs", "cache", "dry")
    parser.add_argument("--other", type=Path, help="folder of the second simulator's scenes")
    parser.add_argument("--lab-scenes", type=int, default=5, help="of each group; 0: none")
    parser.add_argument("--part", action="append", choices=list(PARTS), help="default: all")
    parser.add_argument("--tracker", action="store_true", help="parts of the tracker alone")
    asked = parser.parse_args()
    parts = {name: part for name, part in PARTS.items() if name in (asked.part or PARTS)}
    parts = {name: part for name, part in parts.items() if part.is_tracker or not asked.tracker}
    cache = asked.cache.absolute()
    simulated = recordings(asked.other, asked.lab_scenes, cache)
    found: dict[tuple[str, str], tuple[Units, tuple[PooledFigure, ...]]] = {
        key: (simulated_units(scenes, parts, cache, asked.jobs), SIMULATED)
        for key, scenes in simulated.items()
    }
    marks = read_frames(MARKS / "filinha.json")
    people = RealPeople(*marked(crossing_camera(asked.shared), marks), asked.shared)
    found |= {key: (units, REAL) for key, units in real_units(people, parts).items()}
    test = {where: one for (split, where), one in found.items() if split == "test"}
    text = ["## Verdicts, by the test split", verdicts(parts, test), "## Deleted rules", deleted()]
    for (split, where), (units, of) in found.items():
        unit = "scenes" if of is SIMULATED else "events of real people"
        title = f"## {split.capitalize()} split: {where}, {len(units['best'])} {unit}"
        text += [title, table(units, of)]
    text += ["## Calibration of detections", calibration_tables(simulated, cache, asked.jobs)]
    write(__file__, "Effect of each part beyond the source works", NOTE, *text, dry=asked.dry)
