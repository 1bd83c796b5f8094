"""Motion from pictures beside that from wheels: how far off it is, and what it does to tracks.

Scenarios of [Park 2021] in the virtual lab, filmed in colour; what is not filmed yet is,
which takes some minutes each. Pictures of people who walk before a real camera that stands
(`--shared`) show what is told of a motion that is none.
"""

import argparse
import math
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.lib.rides import Ride, Sample, film_ride
from benchmarks.lib.table import markdown, write
from benchmarks.moving_base import STANDING_MPS, WALKING_MPS, velocities
from benchmarks.odometry import OWN, figures, run, variants
from common.geometry.transform_buffer import transform_from_odometry
from common.geometry.transform_history import TransformBufferConfig, TransformHistory
from common.geometry.transforms import invert, wrap
from common.metrics import Matching, score_matching
from evaluation.cache import default_folder
from evaluation.methods import read_method
from evaluation.pool import Pool
from evaluation.recordings.detections import read_tracker_input
from evaluation.recordings.hand_annotations import crossing_camera
from evaluation.recordings.recordings import plan_recordings, render_recording
from evaluation.recordings.visual_motion import FrameMotion, VisualMotion, write_with_motion
from evaluation.run.preparation import EvaluationPlan, WorkQueue, runs_of
from evaluation.run.run import EvaluationRun, execute
from lab.scenario import load_scenario
from lab.world import EPOCH_NS, World
from people4d.messages import F64, Odometry
from services.camera.config import CameraConfig
from services.detector.config import DetectorConfig
from services.tracker.config import ImageSortConfig
from services.visual_odometry.config import VisualOdometryConfig

ROOT = Path(__file__).resolve().parents[1]
SCENARIOS = ("pmrr", "psrm", "pmrm1", "pmrm2")  # and port1, port2, in which it turns slowly
WAY_M, TURN_DEG = 1.0, 90.0  # of stretches that drift is told of
DYNAMIC = ImageSortConfig(r=10.0, max_age=5.0)  # as chosen on MOT15 (benchmarks/odometry.md)
POSES = (
    *("film", "told by", "frames told %", "turn off by °/frame, RMS (p95)", "°/s"),
    *("way off by mm/frame, RMS", "after 1 m: cm", "after 90°: °", "within 2 sigma %"),
    "ms a frame (p95)",
)
TRACKS = (
    *("film", "motion by", "standing people: speed p50 m/s", "p95 m/s"),
    *("walking people: velocity RMSE m/s", "ID switches a min"),
    *("RMSE across m", "along m", "covered %"),
)
BOXES = ("motion by", "MOTA", "IDF1", "IDsw")


@dataclass(frozen=True)
class RecordedMotion:
    """One film, and what tells the motion in it.

    Args:
        trial: Of the tracker, with the wheels' odometry.
        wheels: That odometry.
        seen: What the pictures tell, of each frame.
        counters: What was counted meanwhile.
        true: Nx4x4, where the base truly was in each frame.
    """

    trial: EvaluationRun
    wheels: tuple[Odometry, ...]
    seen: tuple[FrameMotion, ...]
    counters: dict[str, int]
    true: F64

    @property
    def pictures(self) -> tuple[Odometry, ...]:
        """The odometry that pictures tell."""
        return tuple(one.motion for one in self.seen if isinstance(one.motion, Odometry))

    @property
    def none(self) -> tuple[Odometry, ...]:
        """The odometry of a base that is thought to stand."""
        first = self.wheels[0]
        return tuple(
            Odometry(
                stamp_ns=one.stamp_ns,
                sequence=number,
                frame_id=first.frame_id,
                child_frame_id=first.child_frame_id,
                x_m=0.0,
                y_m=0.0,
                theta_rad=0.0,
            )
            for number, one in enumerate(self.seen)
        )

    def ways(self) -> dict[str, tuple[Odometry, ...]]:
        """Return each way to know the motion, with what it tells."""
        return {"wheels": self.wheels, "pictures": self.pictures, "none": self.none}


def watch(trial: EvaluationRun) -> RecordedMotion:
    """Return what pictures tell of a film, people left out where the detector found them."""
    messages = list(read_tracker_input(trial.detections, None))
    visual = VisualMotion(
        CameraConfig(source=str(trial.recording.path)), VisualOdometryConfig(), messages
    )
    seen = tuple(visual)
    world = World(load_scenario(trial.recording.scenario), trial.recording.seed)
    return RecordedMotion(
        trial,
        tuple(m for m in messages if isinstance(m, Odometry)),
        seen,
        visual.counters,
        np.array([world.path.map_from_base((s.stamp_ns - EPOCH_NS) / 1e9) for s in seen]),
    )


def at_frames(samples: Sequence[Odometry], seen: Sequence[FrameMotion]) -> list[F64 | None]:
    """Return the pose of the base in each frame; None where it would be guessed."""
    trail = TransformHistory(TransformBufferConfig(history_s=1e6, gap_s=0.1), Counter())
    for sample in samples:
        trail.add(sample.stamp_ns, transform_from_odometry(sample))
    placed = [trail.at(one.stamp_ns) for one in seen]
    return [one.matrix if one and not one.is_uncertain else None for one in placed]


def errors(told: Sequence[F64 | None], true: F64, step: Sequence[int]) -> F64:
    """Return how far a told motion is off the true one: Nx2, metres and radians.

    Args:
        told: Poses of the base; those that are not known are passed over.
        true: Nx4x4.
        step: The frame to compare each with, N, later ones than N: none.
    """
    off = []
    for start, end in enumerate(step):
        before, after = told[start], told[end] if end < len(told) else None
        if before is None or after is None:
            continue
        way = invert(before) @ after
        way_true = invert(true[start]) @ true[end]
        wrong = invert(way_true) @ way
        off.append([np.linalg.norm(wrong[:2, 3]), abs(math.atan2(wrong[1, 0], wrong[0, 0]))])
    return np.array(off).reshape(-1, 2)


def stretches(travelled: F64, length: float) -> list[int]:
    """Return for each frame the first one after so much more of way or turn (N: there is none)."""
    return [int(np.searchsorted(travelled, start + length)) for start in travelled]


def pose_row(name: str, way: str, film: RecordedMotion) -> list[str]:
    """Return how far the motion that is told is off."""
    told, true = (
        at_frames(film.ways()[way], film.seen),
        film.true,
    )
    ways = np.linalg.norm(np.diff(true[:, :2, 3], axis=0), axis=1)
    headings = np.unwrap(np.arctan2(true[:, 1, 0], true[:, 0, 0]))
    frames = errors(told, true, range(1, len(told) + 1))
    along = np.concatenate([[0.0], np.cumsum(ways)])
    around = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(headings)))])
    metre = errors(told, true, stretches(along, WAY_M))
    turn = errors(told, true, stretches(around, math.radians(TURN_DEG)))
    rate_hz = 1e9 * (len(true) - 1) / (film.seen[-1].stamp_ns - film.seen[0].stamp_ns)
    turns_deg = np.degrees(frames[:, 1])
    rms_deg = float(np.sqrt(np.mean(turns_deg**2)))
    took_ms = [one.took_ms for one in film.seen]
    pictures = way == "pictures"
    return [
        name,
        way,
        f"{100 * sum(pose is not None for pose in told) / len(told):.1f}",
        f"{rms_deg:.3f} ({np.percentile(turns_deg, 95):.3f})",
        f"{rms_deg * rate_hz:.2f}",
        f"{1000 * np.sqrt(np.mean(frames[:, 0] ** 2)):.1f}",
        f"{100 * np.median(metre[:, 0]):.1f}" if len(metre) else "-",
        f"{np.degrees(np.median(turn[:, 1])):.2f}" if len(turn) else "-",
        f"{100 * sure(film.ways()[way], film):.0f}",
        f"{np.mean(took_ms):.1f} ({np.percentile(took_ms, 95):.1f})" if pictures else "-",
    ]


def sure(samples: Sequence[Odometry], film: RecordedMotion) -> float:
    """Return the share of frames whose heading is within two of its own standard deviations."""
    times = np.array([one.stamp_ns for one in film.seen])
    headings = np.arctan2(film.true[:, 1, 0], film.true[:, 0, 0])
    within = []
    for sample in samples:
        at = int(np.searchsorted(times, sample.stamp_ns))
        if at == len(times) or times[at] != sample.stamp_ns or sample.covariance is None:
            continue
        off = abs(wrap(sample.theta_rad - (headings[at] - headings[0])))
        within.append(off <= 2 * math.sqrt(sample.covariance[2, 2]) + 1e-9)
    return float(np.mean(within)) if within else math.nan


def matching(film: RecordedMotion, samples: Sequence[Odometry], folder: Path) -> Matching:
    """Return what the tracker makes of a film with one odometry, beside the truth."""
    path = folder / "film.mcap"
    told = [FrameMotion(one.stamp_ns, one, 0.0) for one in samples]
    write_with_motion(read_tracker_input(film.trial.detections, None), told, path)
    return execute(replace(film.trial, detections=path)).matching


def track_row(name: str, way: str, result: Matching) -> list[str]:
    """Return what an odometry does to tracks."""
    row, (true, felt) = score_matching(result).row(), velocities(result)
    truly = np.linalg.norm(true, axis=1)
    speeds = np.linalg.norm(felt[truly < STANDING_MPS], axis=1)
    off = (felt - true)[truly >= WALKING_MPS]
    return [
        name,
        way,
        f"{np.median(speeds):.3f}" if len(speeds) else "-",
        f"{np.percentile(speeds, 95):.3f}" if len(speeds) else "-",
        f"{math.sqrt(float(np.mean(np.sum(off**2, axis=1)))):.3f}" if len(off) else "-",
        f"{row['id_switches_per_min'] or 0:.1f}",
        *(f"{row[name] or 0:.3f}" for name in ("position_rmse_across_m", "position_rmse_along_m")),
        f"{100 * (row['coverage'] or 0):.1f}",
    ]


def box_table(films: Iterable[RecordedMotion], cache: Path) -> str:
    """Return what an odometry does to SORT in the image, all films together."""
    settings = variants(OWN, DYNAMIC)
    rides: dict[str, list[Ride]] = {"wheels": [], "pictures": [], "none": []}
    for one in films:
        ride = film_ride(one.trial.recording.path, DetectorConfig(crops=False), cache)
        for way, samples in one.ways().items():
            prompt = tuple(Sample(sample, sample.stamp_ns) for sample in samples)
            rides[way].append(replace(ride, samples=prompt))
    rows = []
    for way, some in rides.items():
        chosen = settings["SORT+Dynamic" if way == "none" else "SORT+Odom+Dynamic"]
        told = figures([run(chosen, ride) for ride in some])
        rows.append([way, f"{told[0]:.1f}", f"{told[4]:.1f}", f"{told[7]:.0f}"])
    return markdown(BOXES, rows)


def standing_camera(shared: Path) -> str:
    """Return what is told of a real camera that stands before up to six people who walk."""
    camera = crossing_camera(shared)
    if not Path(camera.source).exists():
        return "Without the reference data (`--shared`) no real camera was judged."
    visual = VisualMotion(camera, VisualOdometryConfig())
    seen = list(visual)
    poses = [one.motion for one in seen if isinstance(one.motion, Odometry)]
    away_mm = [1000 * math.hypot(p.x_m, p.y_m) for p in poses]
    turned_deg = [math.degrees(abs(p.theta_rad)) for p in poses]
    causes = ", ".join(f"{k} {n}" for k, n in visual.counters.items() if n)
    return (
        f"A real camera that stands (108 frames of up to six people who walk before it, found by "
        f"nobody): motion is told of {100 * len(poses) / len(seen):.0f} % of the frames; the place "
        f"is off by {np.median(away_mm):.1f} mm in the median and {max(away_mm):.1f} mm at most, "
        f"the heading by {np.median(turned_deg):.3f}° and {max(turned_deg):.3f}°, at the end by "
        f"{away_mm[-1]:.1f} mm and {turned_deg[-1]:.3f}°. Counted: {causes}."
    )


def main() -> None:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description="Judge odometry from pictures.")
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    parser.add_argument("--scenarios", nargs="+", default=list(SCENARIOS))
    parser.add_argument("--seed", type=int, default=102)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    cache = default_folder()
    takes = plan_recordings(
        [f"lab:{s}" for s in arguments.scenarios], [arguments.seed], "colour", cache
    )
    for take in takes:
        render_recording(take, 1, lambda what, share: print(f"{what} {100 * share:.0f} %"))
    plan = EvaluationPlan((read_method("best"),), tuple(takes), cache)
    with Pool(1) as pool:
        trials = runs_of(plan, WorkQueue(pool, lambda what, share: print(f"{what} {share:.2f}")))
    films = {trial.recording.scenario: watch(trial) for trial in trials}
    poses, tracks = [], []
    with tempfile.TemporaryDirectory() as scratch:
        for name, one in films.items():
            poses += [pose_row(name, way, one) for way in ("wheels", "pictures")]
            for way, samples in one.ways().items():
                tracks.append(track_row(name, way, matching(one, samples, Path(scratch))))
    counted = Counter[str]()
    for one in films.values():
        counted.update(one.counters)
    causes = ", ".join(f"{name} {count}" for name, count in counted.items() if count)
    write(
        __file__,
        "Motion from pictures",
        INTRODUCTION.format(seed=arguments.seed),
        "## How far off it is",
        markdown(POSES, poses),
        f"Counted in all films together: {causes}.",
        standing_camera(arguments.shared),
        "## What it does to people in 3D (preset best)",
        markdown(TRACKS, tracks),
        "## What it does to boxes in the image (SORT, dynamic survival, this project's settings)",
        box_table(films.values(), cache),
    )


INTRODUCTION = """\
Films of the virtual lab in colour, seed {seed} (settings were chosen on 101): 640x480 pixels at 15
or 20 Hz, blurred by 15 ms of exposure, depth up to 5 m with the errors of a D435i; boxes of people
are MoveNet's. *Wheels* is the lab's odometry of wheels that slip, with errors of radius and track;
*none* believes that the base stands. *Off by* is the error of the motion from one frame to the
next; *after 1 m* and *after 90°* is the median error over all stretches of that much way and turn.
*Within 2 sigma*: share of frames whose heading, counted from the start, is as near to the truth as
its covariance says. Milliseconds are of processor time, in one thread of a machine that does other
work, too."""


if __name__ == "__main__":
    main()
