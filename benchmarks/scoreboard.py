"""Tables of all recordings of real people, of a second simulator, and of other packages.

`--shared` names the folder of the recordings, which show identifiable people and are not
published. `--peers` names Python interpreters of environments with other packages, see
`lib/peers/mot.py`, and `--other` the folder of the second simulator's scenes, see `ablation`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.ablation import recordings, report_progress, score_scene
from benchmarks.lib import options
from benchmarks.lib.each import each
from benchmarks.lib.intervals import Interval, jackknife
from benchmarks.lib.marks import stills
from benchmarks.lib.marks.crossing import FPS, crossing_camera
from benchmarks.lib.marks.methods import MARKS, ROOT, variants
from benchmarks.lib.marks.peers import crossing_peers
from benchmarks.lib.marks.recording import marked, run
from benchmarks.lib.marks.scores import MarkScores
from benchmarks.lib.marks.stills import FELIX_HZ
from benchmarks.lib.odometry.rides import Ride, kitti_ride
from benchmarks.lib.peers.boxes import HELD_OUT, TUNING, mot15_rides, track, track_peers
from benchmarks.lib.prediction.score import predict_walks
from benchmarks.lib.table import markdown, write
from common.metrics.pose import rmse
from common.metrics.scores import Row, combine
from evaluation.annotations.marks import read_frames
from evaluation.datasets.walks import read_walks
from evaluation.methods import read_method
from evaluation.pool import Pool
from evaluation.run.preparation import EvaluationPlan, check_models, render_all, runs_of
from people4d.messages import F64
from services.detector.config import shipped_model
from services.predictor.config import PredictorConfig

OUT = ROOT / "out" / "scoreboard"
BLOCK_FRAMES = 10  # length of a unit of annotated frames: one second
WALK_UNITS = 20  # number of units of a scene of pedestrians
ADE = PredictorConfig(step_s=0.4, steps=12)  # horizon of 4.8 s, as in published figures
HISTORY_MIN = 8  # number of annotations before such a prediction
SEED = 101  # seed of the detector's errors on KITTI
DETECTION = ("recall", "position_rmse_m", "yaw_rmse_deg")  # figures of detections alone
IMAGE_SORT = tuple(f"image-sort{end}" for end in ("", "-dynamic"))
ODOMETRY = tuple(f"image-sort{end}" for end in ("-odom", "-odom-dynamic"))
NOTE = """
All recordings, with 95 % intervals [low, high] from a delete-one jackknife over units. `Found`:
annotated people with a track (or detection), `identity`: with the one track of their person over
the whole recording. Errors are root mean squares. `ADE`, `FDE`: mean and final displacement error
of predictions [8 annotations seen, 12 predicted, 0.4 s apart]. `-` and columns left out: not
defined or not published. An interval of no width: all units are alike. `Frames/s`: tracker alone,
one thread.

Other packages get the same boxes and scores. Each has the settings, of those in
lib/peers/mot.py, that are best in a tuning split: the first half of filinha (correct identities),
or ETH-Bahnhof and TUD-Stadtmitte (MOTA + IDF1 + HOTA). All our methods run as shipped.

- filinha: 106 frames of six people who occlude each other, 10 Hz, annotated by hand in the images
  alone. Positions are compared with the surface at the annotation. Units: one second.
- TUE, uc3m, outdoors: single images, detections alone, units: images. TUE: most people behind a
  desk. uc3m: persons by masks, and an empty room with a humanoid robot. MOTA is 1 minus the shares
  of missed people and false detections.
- felix: one man twice, seated and standing; 40 frames, arms before the body. Units: one second.
- MOT15: public detections, {held_out}. Units: two seconds.
- KITTI: labels of a street seen from a moving car, 2D boxes with a detector's errors (a fifth is
  missed, 2 % of the height), and the car's poses as odometry. Units: twentieths.
- ETH, UCY: paths of pedestrians seen from above. Units: twentieths of the recording.
- second simulator: scenes on which no constant was chosen. Units: scenes.

MoveNet is {movenet}, the default on this processor.
""".strip()


@dataclass(frozen=True)
class Column:
    """A figure of the table."""

    title: str
    key: str  # name in a row of figures
    form: str = "{:.1f}"
    factor: float = 1.0
    low: float = 0.0  # smallest possible value
    high: float = np.inf

    def cell(self, interval: Interval | None) -> str:
        """Return a figure with its interval as text, "-" if it is not defined."""
        if interval is None:
            return "-"
        value, *limits = (self.factor * x for x in interval)
        text = self.form.format(value)
        if np.isnan(limits).any() or self.key == "rate_hz":
            return text
        low, high = (self.form.format(min(max(x, self.low), self.high)) for x in limits)
        return f"{text} [{low}, {high}]"


COLUMNS = (
    Column("found %", "recall", factor=100, high=100),
    Column("identity %", "idr", factor=100, high=100),
    Column("IDF1 %", "idf1", factor=100, high=100),
    Column("HOTA %", "hota", factor=100, high=100),
    Column("MOTA %", "mota", factor=100, low=-np.inf, high=100),
    Column("switches a min", "id_switches_per_min"),
    Column("position m", "position_rmse_m", "{:.3f}"),
    Column("velocity m/s", "velocity_rmse_mps", "{:.3f}"),
    Column("yaw deg", "yaw_rmse_deg"),
    Column("ADE m", "ade", "{:.2f}"),
    Column("FDE m", "fde", "{:.2f}"),
    Column("frames/s", "rate_hz", "{:.0f}"),
)


@dataclass(frozen=True)
class Entry:
    """One method on one input."""

    source: str
    method: str
    units: int
    row: Callable[[Sequence[int]], Mapping[str, float | None]]  # figures over some units

    def cells(self) -> list[str]:
        """Return the line of the table."""
        found = jackknife(self.row, self.units)
        cells = [column.cell(found.get(column.key)) for column in COLUMNS]
        return [self.source, self.method, str(self.units), *cells]


def marks_entry(source: str, method: str, scores: MarkScores, block: int, keys: str = "") -> Entry:
    """Return a method on annotated frames, with some of the figures."""
    blocks = [scores.frames[k : k + block] for k in range(0, len(scores.frames), block)]

    def row(chosen: Sequence[int]) -> Row:
        found = scores.within({frame for unit in chosen for frame in blocks[unit]}).row()
        return {name: found[name] for name in (keys.split() or found)}

    return Entry(source, method, len(blocks), row)


def crossing(shared: Path, peers: Sequence[str]) -> Iterator[Entry]:
    """Yield all methods on the long recording, and other packages on the same detections."""
    camera = crossing_camera(shared)
    recording, _ = marked(camera, read_frames(MARKS / "filinha.json"))
    for variant in variants(shared):
        outputs = run(variant.method(), camera, OUT)
        methods = {variant.name: recording.hypotheses(outputs)}
        if variant.detector:
            for python in peers:
                others = crossing_peers(python, recording, outputs)
                methods |= {f"{variant.detector}, {name}": one for name, one in others.items()}
        for name, tracks in methods.items():
            scores = MarkScores(recording.truth, tracks, FPS)
            yield marks_entry("filinha", name, scores, BLOCK_FRAMES)
        if variant.detector:
            detected = recording.detected(one.detections for one in outputs)
            scores = MarkScores(recording.truth, detected, FPS)
            name = f"{variant.detector}, detections alone"
            yield marks_entry("filinha", name, scores, BLOCK_FRAMES, " ".join(DETECTION))


def other_images(shared: Path) -> Iterator[Entry]:
    """Yield the other annotated pictures with both detectors."""
    data = shared / "data" / "rgbd"
    for variant in (one for one in variants(shared) if one.detector):
        name = f"{variant.detector}, detections alone"
        still = {"TUE": list(stills.tue(data)), "uc3m": [stills.uc3m(data, OUT)]}
        still["outdoors"] = [stills.outdoors(data, OUT)]
        for source, sets in still.items():
            scores = stills.still_scores(variant.method(), sets, OUT)
            yield marks_entry(source, name, scores, 1, f"{' '.join(DETECTION)} mota")
        felix = stills.felix(data)
        recording, _ = marked(felix.camera, felix.marks)
        tracks = recording.hypotheses(run(variant.method(), felix.camera, OUT))
        scores = MarkScores(recording.truth, tracks, FELIX_HZ)
        yield marks_entry("felix", variant.name, scores, BLOCK_FRAMES)


def boxes(shared: Path, peers: Sequence[str]) -> Iterator[Entry]:
    """Yield trackers of boxes on MOT15 and KITTI."""
    kitti = [kitti_ride(shared / "data" / "egomotion" / "kitti_0019", SEED)]
    inputs: dict[str, tuple[list[Ride], tuple[str, ...]]] = {
        "MOT15": (mot15_rides(shared, HELD_OUT), IMAGE_SORT),
        "KITTI": (kitti, IMAGE_SORT + ODOMETRY),
    }
    for source, (rides, presets) in inputs.items():
        for name in presets:
            ours = track(read_method(name).tracker.image_sort, rides)
            yield Entry(source, f"preset {name}", len(ours.blocks), ours.row)
    for python in peers:
        tried = track_peers(python, mot15_rides(shared, TUNING), {})
        best = {
            tracker: max(results, key=lambda number: results[number].quality)
            for tracker, results in tried.items()
        }
        chosen = {tracker: [number] for tracker, number in best.items()}
        for source, (rides, _) in inputs.items():
            for tracker, results in track_peers(python, rides, chosen).items():
                one = results[best[tracker]]
                yield Entry(source, f"{tracker} {one.settings}", len(one.blocks), one.row)


def walks(shared: Path) -> Iterator[Entry]:
    """Yield predictions on the paths of pedestrians."""
    for folder in sorted((shared / "data" / "trajectories").iterdir()):
        if not folder.is_dir():
            continue
        pairs, _ = predict_walks(read_walks(folder), ADE, HISTORY_MIN)
        names = ("preset best", "constant velocity")
        for method, errors_m in zip(names, pairs.displacements_m(), strict=True):
            parts = np.array_split(errors_m, WALK_UNITS)

            def row(chosen: Sequence[int], parts: Sequence[F64] = parts) -> dict[str, float | None]:
                here_m = np.concatenate([parts[unit] for unit in chosen])
                return {"ade": float(here_m.mean()), "fde": float(here_m[:, -1].mean())}

            yield Entry(folder.name, method, WALK_UNITS, row)


def simulated(other: Path, cache: Path, jobs: int) -> Iterator[Entry]:
    """Yield `best` on the second simulator."""
    (scenes,) = recordings(other, 0, cache).values()
    methods = (read_method("best"),)
    plan = EvaluationPlan(methods, tuple(scenes), cache.absolute(), jobs, figures=False)
    check_models(plan)
    render_all(plan, report_progress)
    with Pool(jobs, report_progress) as pool:
        results = pool.do("tracking", score_scene, runs_of(plan, pool))

    def row(chosen: Sequence[int]) -> Row:
        scores = combine(results[unit].scores for unit in chosen)
        return scores.row() | {
            "recall": scores.lifetimes.coverage,
            "position_rmse_m": rmse(np.linalg.norm(scores.pose.position_m, axis=1)),
            "velocity_rmse_mps": rmse(np.linalg.norm(scores.pose.velocity_mps, axis=1)),
        }

    yield Entry("second simulator", "preset best", len(results), row)


def sections(lines: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield heading and table of each input, without the columns that are defined for no row."""
    header = ("method", "units", *(column.title for column in COLUMNS))
    for source in dict.fromkeys(line[0] for line in lines):
        rows = [line[1:] for line in lines if line[0] == source]
        used = [k for k, cells in enumerate(zip(*rows, strict=True)) if {*cells} != {"-"}]
        yield f"## {source}"
        yield markdown([header[k] for k in used], [[row[k] for k in used] for row in rows])


def main() -> None:
    """Measure and write the tables."""
    parser = options.parser(__doc__, "shared", "jobs", "cache", "dry")
    parser.add_argument("--peers", nargs="*", default=[], help="interpreters with other packages")
    parser.add_argument("--other", type=Path, help="folder of the second simulator's scenes")
    asked = parser.parse_args()
    entries = [*crossing(asked.shared, asked.peers), *other_images(asked.shared)]
    entries += [*boxes(asked.shared, asked.peers), *walks(asked.shared)]
    if asked.other:
        entries += simulated(asked.other, asked.cache, asked.jobs)
    note = NOTE.format(held_out=", ".join(HELD_OUT), movenet=shipped_model())
    lines = each(Entry.cells, entries)
    write(__file__, "Scoreboard", note, *sections(lines), dry=asked.dry)
