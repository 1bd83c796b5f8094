"""Effect of each part beyond the source works: the preset `best`, and `best` less one part.

On random scenes of the lab whose seeds are for choosing (lab_people.md) and on real people in the
variations of their recording (real_variations.md), with two detectors; the recording is not part of
the repository, `--shared` names the folder that holds it. Renderings and detections of the lab stay
in the cache of `people4d evaluate`: the same command goes on.
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import msgspec

from benchmarks.lab_people import COLUMNS, GROUPS, report_progress, text, try_out
from benchmarks.lib import options
from benchmarks.lib.marks.methods import DEFAULT, HALVES, MARKS, variants
from benchmarks.lib.marks.recording import MarkedRecording, marked
from benchmarks.lib.marks.variations import IMAGES, VariedDetections, detect, vary
from benchmarks.lib.table import markdown, write
from benchmarks.real_variations import VariationScores, percent, score_detected, total
from common.metrics.scores import combine
from evaluation.methods import Method, read_method
from evaluation.pool import Pool
from evaluation.recordings.detection_cache import DetectionCache
from evaluation.recordings.hand_annotations import crossing_camera
from evaluation.recordings.hand_marks import read_frames
from evaluation.recordings.mark_scores import figures
from evaluation.recordings.recordings import plan_recordings
from evaluation.run.preparation import EvaluationPlan, check_models, render_all, runs_of
from evaluation.run.run import RunScores
from services.camera.source import SourceFrame
from services.tracker.strongsort3d.config import COSINE_DISTANCE_MAX

SCENES = ",".join(f"lab:{scene}" for scene in GROUPS.values())
SEEDS = "900,901,902,903,904"  # for choosing
DARK = "six in dark clothes"
DARK_SEEDS = range(840, 865)  # likewise
FAITHFUL = "pose-strongsort-movenet"
STRONG = "tracker.strongsort3d"
ROUND_1_MAX = COSINE_DISTANCE_MAX["appearance"]  # that of OSNet is 0.01 less
# What is left out, and the settings that do so.
PARTS: dict[str, tuple[str, ...]] = {
    "surface to axis": ("detector.to_axis=false",),
    "position of the torso": ("detector.position=keypoints",),
    "boxes on two people": ("detector.torso.layer.beside_m=0",),
    "people beyond the range of depth": ("detector.torso.layer.missing_weight=0",),
    "measured velocity": ("detector.velocity.enabled=false",),
    "measured covariance": (f"{STRONG}.noise=constant",),
    "orientation network": ("detector.orientation.network.model=",),
    "joint orientation": ("detector.orientation.method=separate",),
    "weighted orientation": (
        "detector.orientation.method=separate",
        "detector.orientation.weighted=false",
    ),
    "density of yaw": ("tracker.yaw=kalman",),
    "turning": ("tracker.yaw_filter.rate_gain=0",),
    "occlusion": (f"{STRONG}.occlusion.enabled=false",),
    "contact": (f"{STRONG}.contact.enabled=false",),
    "identity": (f"{STRONG}.identity.enabled=false",),
    "limit of re-identification": (f"{STRONG}.identity.match_max={ROUND_1_MAX}",),
    "likelihood in round 1": (f"{STRONG}.likelihood=false",),
    "life cycle by hits": (f"{STRONG}.lifetime=streak", f"{STRONG}.n_init=3"),
    "standing model": (f"{STRONG}.imm.enabled=false",),
    "jumps of position": (f"{STRONG}.jump_min=inf",),
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


DETECTORS = {
    "MoveNet": DEFAULT,
    "with histogram": "MoveNet, histogram",
    "YOLO": "YOLOv8n-pose, OSNet",
}
REAL_COLUMNS = (*HALVES, "worst variation", "changes", "> 0.5 m off", "facing")
REAL_HEADER = ("method", *(f"{name}: {column}" for name in DETECTORS for column in REAL_COLUMNS))
DARK_COLUMNS = (
    *((figure, f"dark: {title}", form) for figure, title, form in COLUMNS),
    ("idf1", "dark: IDF1", "{:.1%}"),
)
LAB_HEADER = ("method", *(title for _, title, _ in (*COLUMNS, *DARK_COLUMNS)))


@dataclass(frozen=True)
class RealPeople:
    """A recording in variations, with what detectors found in it so far."""

    recording: MarkedRecording
    images: Sequence[SourceFrame]
    shared: Path
    networks: dict[str, list[DetectionCache]] = field(default_factory=dict)
    found: dict[bytes, list[VariedDetections]] = field(default_factory=dict)

    def cells(self, settings: Sequence[str], preset: str) -> list[str]:
        """Return the figures of a method with each detector."""
        known = {one.name: one for one in variants(self.shared)}
        chosen = [known[name] for name in DETECTORS.values()]
        methods = [read_method(preset, (*one.settings, *settings)) for one in chosen]
        return [cell for method in methods for cell in real_cells(self._scores(method))]

    def _scores(self, method: Method) -> list[VariationScores]:
        key = msgspec.json.encode((method.detector, method.reid))
        if key not in self.found:
            self.found[key] = self._detect(method)
        return [
            one
            for variation, detections in zip(IMAGES, self.found[key], strict=True)
            for one in score_detected(method, self.recording, variation, detections)
        ]

    def _detect(self, method: Method) -> list[VariedDetections]:
        empty = [DetectionCache() for _ in IMAGES]
        caches = self.networks.setdefault(method.detector.model, empty)
        return [
            detect(method, vary(self.recording, variation).view, self.images, variation, cache)
            for variation, cache in zip(IMAGES, caches, strict=True)
        ]


def real_cells(results: Sequence[VariationScores]) -> list[str]:
    """Return the figures of a method on real people; identities of those less than half hidden."""
    by_half = [[one.owned(half) for one in results] for half in HALVES.values()]
    every = [figures(one.scores.outcomes) for one in results]
    forward = [f for f, one in zip(every, results, strict=True) if not one.order.reversed]
    together = [total(shares) for shares in zip(*by_half, strict=True)]
    worst = min(together, key=lambda share: share.part / share.total)
    return [
        *(percent(total(shares)) for shares in by_half),
        percent(worst),
        str(sum(one.scores.id_switches for one in results)),
        str(total([f.far for f in every]).part),
        percent(total([f.facing for f in forward])),
    ]


def lab_rows(results: Sequence[RunScores], dark: Container[str]) -> list[list[str]]:
    """Return a line for each method; scenes, and those named in `dark`, as one recording each."""
    lines = []
    for name in dict.fromkeys(result.method for result in results):
        own = [result for result in results if result.method == name]
        groups = [
            ([one for one in own if one.recording.name not in dark], COLUMNS),
            ([one for one in own if one.recording.name in dark], DARK_COLUMNS),
        ]
        cells = [name]
        for group, columns in groups:
            row = combine(one.scores for one in group).row()
            cells += [text(row, figure, form) for figure, _, form in columns]
        lines.append(cells)
    return lines


def main() -> None:
    """Judge all methods on all scenes and write the table."""
    parser = options.parser(__doc__, "shared", "jobs", "cache", "dry")
    parser.add_argument("--scenes", default=SCENES, help="as of people4d evaluate --recordings")
    parser.add_argument("--fidelity", choices=("geometry", "depth", "colour"), default="colour")
    parser.add_argument("--seeds", default=SEEDS, help="of scenarios that name none")
    parser.add_argument("--tracker", action="store_true", help="parts of the tracker alone")
    asked = parser.parse_args()
    seeds = [int(seed) for seed in asked.seeds.split(",") if seed]
    cache = asked.cache.absolute()
    recordings = plan_recordings(asked.scenes.split(","), seeds, asked.fidelity, cache)
    dark = plan_recordings([f"lab:{GROUPS[DARK]}"], DARK_SEEDS, asked.fidelity, cache)
    compared = methods(asked.tracker)
    plan = EvaluationPlan(tuple(compared), (*recordings, *dark), cache, asked.jobs, figures=False)
    check_models(plan)
    render_all(plan, report_progress)
    with Pool(plan.jobs, report_progress) as pool:
        results = pool.do("tracking", try_out, runs_of(plan, pool))
    cv2.setNumThreads(1)
    marks = read_frames(MARKS / "filinha.json")
    people = RealPeople(*marked(crossing_camera(asked.shared), marks), asked.shared)
    real = list[list[str]]()
    for k, one in enumerate(compared):
        report_progress("real people", k / len(compared))
        settings = PARTS.get(one.name.removeprefix("- "), ())
        preset = FAITHFUL if one.name == FAITHFUL else "best"
        real.append([one.name, *people.cells(settings, preset)])
    tables = (
        markdown(LAB_HEADER, lab_rows(results, {one.name for one in dark})),
        markdown(REAL_HEADER, real),
    )
    if asked.dry:
        print(*tables, sep="\n\n")
        return
    note = (
        f"`best`, and less one part {'of the tracker ' * asked.tracker}in each line"
        f"{'' if asked.tracker else ', and the third method of [PIC4SeR] as it states it'}."
    )
    lab_note = (
        f"Scenes of the groups of lab_people.md ({asked.fidelity}), seeds {asked.seeds}; `dark`: "
        f"{DARK}, seeds {DARK_SEEDS[0]} to {DARK_SEEDS[-1]}. All these are for choosing. Scenes "
        f"together, over all frames in which a person is in view and at least 35 % of them is "
        f"visible, measured or predicted; re-identified are those who come back after two seconds "
        f"or more. The standing model is for people who stand, whose speed is in moving_base.md."
    )
    real_note = (
        "Six people who hide each other, in the 35 variations of real_variations.md, with MoveNet "
        "and the appearance network, with MoveNet and the histogram, and with YOLOv8n-pose and "
        "OSNet: right identity of those less than half hidden, by half of the recording (the first "
        "is for choosing) and in the worst variation; changes of identity, positions more than "
        "0.5 m off, facing within 45 degrees."
    )
    lab, people_there = tables
    write(
        __file__,
        "What each part beyond the source works is worth",
        *(note, "## The virtual lab", lab_note, lab),
        *("## Real people", real_note, people_there),
    )
