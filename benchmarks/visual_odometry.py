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

from benchmarks.lib.odometry.rides import Ride, Sample, rendered_ride
from benchmarks.lib.odometry.tables import OWN, figures, run, variants
from benchmarks.lib.table import markdown, write
from benchmarks.moving_base import STANDING_MPS, WALKING_MPS, velocities
from common.geometry.transform_buffer import transform_from_odometry
from common.geometry.transform_history import TransformBufferConfig, TransformHistory
from common.geometry.transforms import invert, wrap
from common.metrics.matching import Matching
from common.metrics.scores import score_matching
from evaluation.cache import default_folder
from evaluation.methods import read_method
from evaluation.pool import Pool
from evaluation.recordings.detections import read_tracker_input
from evaluation.recordings.hand_annotations import crossing_camera
from evaluation.recordings.recordings import plan_recordings, render_recording
from evaluation.recordings.visual_motion import FrameMotion, VisualMotion, write_with_motion
from evaluation.run.preparation import EvaluationPlan, runs_of
from evaluation.run.run import EvaluationRun, execute
from lab.catalogue import load_scenario
from lab.world import EPOCH_NS, World
from people4d.messages import F64, Odometry
from services.camera.config import CameraConfig
from services.detector.config import DetectorConfig
from services.tracker.config import ImageSortConfig
from services.visual_odometry.config import VisualOdometryConfig

ROOT = Path(__file__).resolve().parents[1]
SCENARIOS = ("pmrr", "psrm", "pmrm1", "pmrm2")  # and port1, port2, in which it turns slowly
DISTANCE_M, TURN_DEG = 1.0, 90.0  # of stretches that drift is told of
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
    """Motion of the base in one rendered recording.

    Args:
        evaluation_run: Run of the tracker with wheel odometry.
        wheels: Wheel odometry.
        frames: Visual odometry of each frame.
        counters: Events of visual odometry.
        true: Nx4x4, true poses of the base at the frames.
    """

    evaluation_run: EvaluationRun
    wheels: tuple[Odometry, ...]
    frames: tuple[FrameMotion, ...]
    counters: dict[str, int]
    true: F64

    @property
    def visual(self) -> tuple[Odometry, ...]:
        """Visual odometry."""
        return tuple(one.motion for one in self.frames if isinstance(one.motion, Odometry))

    @property
    def none(self) -> tuple[Odometry, ...]:
        """Odometry of a base that is assumed to stand."""
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
            for number, one in enumerate(self.frames)
        )

    def sources(self) -> dict[str, tuple[Odometry, ...]]:
        """Return the odometry of each source."""
        return {"wheels": self.wheels, "pictures": self.visual, "none": self.none}


def watch(evaluation_run: EvaluationRun) -> RecordedMotion:
    """Return visual odometry of a rendered recording; points on detected people are left out."""
    messages = list(read_tracker_input(evaluation_run.detections, None))
    visual = VisualMotion(
        CameraConfig(source=str(evaluation_run.recording.path)), VisualOdometryConfig(), messages
    )
    frames = tuple(visual)
    world = World(load_scenario(evaluation_run.recording.scenario), evaluation_run.recording.seed)
    return RecordedMotion(
        evaluation_run,
        tuple(m for m in messages if isinstance(m, Odometry)),
        frames,
        visual.counters,
        np.array([world.path.map_from_base((s.stamp_ns - EPOCH_NS) / 1e9) for s in frames]),
    )


def at_frames(samples: Sequence[Odometry], frames: Sequence[FrameMotion]) -> list[F64 | None]:
    """Return the pose of the base in each frame; None where it would be guessed."""
    history = TransformHistory(TransformBufferConfig(history_s=1e6, gap_s=0.1), Counter())
    for sample in samples:
        history.add(sample.stamp_ns, transform_from_odometry(sample))
    poses = [history.at(one.stamp_ns) for one in frames]
    return [one.matrix if one and not one.is_uncertain else None for one in poses]


def errors(estimated: Sequence[F64 | None], true: F64, step: Sequence[int]) -> F64:
    """Return the errors of an estimated motion: Nx2, metres and radians.

    Args:
        estimated: Poses of the base, None where unknown.
        true: Nx4x4.
        step: The frame to compare each with, N, later ones than N: none.
    """
    off = []
    for start, end in enumerate(step):
        before, after = estimated[start], estimated[end] if end < len(estimated) else None
        if before is None or after is None:
            continue
        step_estimated = invert(before) @ after
        step_true = invert(true[start]) @ true[end]
        wrong = invert(step_true) @ step_estimated
        off.append([np.linalg.norm(wrong[:2, 3]), abs(math.atan2(wrong[1, 0], wrong[0, 0]))])
    return np.array(off).reshape(-1, 2)


def stretches(travelled: F64, length: float) -> list[int]:
    """Return for each frame the first one a distance or angle later (N: there is none)."""
    return [int(np.searchsorted(travelled, start + length)) for start in travelled]


def pose_row(name: str, source: str, recorded: RecordedMotion) -> list[str]:
    """Return the errors of the estimated motion as a row."""
    estimated, true = (
        at_frames(recorded.sources()[source], recorded.frames),
        recorded.true,
    )
    steps_m = np.linalg.norm(np.diff(true[:, :2, 3], axis=0), axis=1)
    headings = np.unwrap(np.arctan2(true[:, 1, 0], true[:, 0, 0]))
    frames = errors(estimated, true, range(1, len(estimated) + 1))
    along = np.concatenate([[0.0], np.cumsum(steps_m)])
    around = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(headings)))])
    metre = errors(estimated, true, stretches(along, DISTANCE_M))
    turn = errors(estimated, true, stretches(around, math.radians(TURN_DEG)))
    rate_hz = 1e9 * (len(true) - 1) / (recorded.frames[-1].stamp_ns - recorded.frames[0].stamp_ns)
    turns_deg = np.degrees(frames[:, 1])
    rms_deg = float(np.sqrt(np.mean(turns_deg**2)))
    took_ms = [one.took_ms for one in recorded.frames]
    visual = source == "pictures"
    return [
        name,
        source,
        f"{100 * sum(pose is not None for pose in estimated) / len(estimated):.1f}",
        f"{rms_deg:.3f} ({np.percentile(turns_deg, 95):.3f})",
        f"{rms_deg * rate_hz:.2f}",
        f"{1000 * np.sqrt(np.mean(frames[:, 0] ** 2)):.1f}",
        f"{100 * np.median(metre[:, 0]):.1f}" if len(metre) else "-",
        f"{np.degrees(np.median(turn[:, 1])):.2f}" if len(turn) else "-",
        f"{100 * consistency(recorded.sources()[source], recorded):.0f}",
        f"{np.mean(took_ms):.1f} ({np.percentile(took_ms, 95):.1f})" if visual else "-",
    ]


def consistency(samples: Sequence[Odometry], recorded: RecordedMotion) -> float:
    """Return the share of frames whose heading is within two of its own standard deviations."""
    times = np.array([one.stamp_ns for one in recorded.frames])
    headings = np.arctan2(recorded.true[:, 1, 0], recorded.true[:, 0, 0])
    within = []
    for sample in samples:
        at = int(np.searchsorted(times, sample.stamp_ns))
        if at == len(times) or times[at] != sample.stamp_ns or sample.covariance is None:
            continue
        off = abs(wrap(sample.theta_rad - (headings[at] - headings[0])))
        within.append(off <= 2 * math.sqrt(sample.covariance[2, 2]) + 1e-9)
    return float(np.mean(within)) if within else math.nan


def matching(recorded: RecordedMotion, samples: Sequence[Odometry], folder: Path) -> Matching:
    """Return tracks of a recording with one odometry, matched to the truth."""
    path = folder / "film.mcap"
    estimated = [FrameMotion(one.stamp_ns, one, 0.0) for one in samples]
    write_with_motion(read_tracker_input(recorded.evaluation_run.detections, None), estimated, path)
    return execute(replace(recorded.evaluation_run, detections=path)).matching


def track_row(name: str, source: str, result: Matching) -> list[str]:
    """Return the errors of tracks with one odometry as a row."""
    row, (true, felt) = score_matching(result).row(), velocities(result)
    truly = np.linalg.norm(true, axis=1)
    speeds = np.linalg.norm(felt[truly < STANDING_MPS], axis=1)
    off = (felt - true)[truly >= WALKING_MPS]
    return [
        name,
        source,
        f"{np.median(speeds):.3f}" if len(speeds) else "-",
        f"{np.percentile(speeds, 95):.3f}" if len(speeds) else "-",
        f"{math.sqrt(float(np.mean(np.sum(off**2, axis=1)))):.3f}" if len(off) else "-",
        f"{row['id_switches_per_min'] or 0:.1f}",
        *(f"{row[name] or 0:.3f}" for name in ("position_rmse_across_m", "position_rmse_along_m")),
        f"{100 * (row['coverage'] or 0):.1f}",
    ]


def box_table(runs: Iterable[RecordedMotion], cache: Path) -> str:
    """Return scores of SORT in the image with each odometry, over all recordings."""
    settings = variants(OWN, DYNAMIC)
    rides: dict[str, list[Ride]] = {"wheels": [], "pictures": [], "none": []}
    for one in runs:
        ride = rendered_ride(one.evaluation_run.recording.path, DetectorConfig(crops=False), cache)
        for source, samples in one.sources().items():
            prompt = tuple(Sample(sample, sample.stamp_ns) for sample in samples)
            rides[source].append(replace(ride, samples=prompt))
    rows = []
    for source, some in rides.items():
        chosen = settings["SORT+Dynamic" if source == "none" else "SORT+Odom+Dynamic"]
        estimated = figures([run(chosen, ride) for ride in some])
        rows.append([source, f"{estimated[0]:.1f}", f"{estimated[4]:.1f}", f"{estimated[7]:.0f}"])
    return markdown(BOXES, rows)


def standing_camera(shared: Path) -> str:
    """Return errors of a real camera that stands before up to six people who walk."""
    camera = crossing_camera(shared)
    if not Path(camera.source).exists():
        return "Without the reference data (`--shared`) no real camera was judged."
    visual = VisualMotion(camera, VisualOdometryConfig())
    frames = list(visual)
    poses = [one.motion for one in frames if isinstance(one.motion, Odometry)]
    away_mm = [1000 * math.hypot(p.x_m, p.y_m) for p in poses]
    turned_deg = [math.degrees(abs(p.theta_rad)) for p in poses]
    causes = ", ".join(f"{k} {n}" for k, n in visual.counters.items() if n)
    return (
        "A real camera that stands (108 frames of up to six people who walk before it, without a "
        f"detector): {100 * len(poses) / len(frames):.0f} % of frames have a motion; the position "
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
    recordings = plan_recordings(
        [f"lab:{s}" for s in arguments.scenarios], [arguments.seed], "colour", cache
    )
    for recording in recordings:
        render_recording(recording, 1, lambda what, share: print(f"{what} {100 * share:.0f} %"))
    plan = EvaluationPlan((read_method("best"),), tuple(recordings), cache)
    with Pool(1, lambda what, share: print(f"{what} {share:.2f}")) as pool:
        evaluated = runs_of(plan, pool)
    runs = {
        evaluation_run.recording.scenario: watch(evaluation_run) for evaluation_run in evaluated
    }
    poses, tracks = [], []
    with tempfile.TemporaryDirectory() as scratch:
        for name, one in runs.items():
            poses += [pose_row(name, source, one) for source in ("wheels", "pictures")]
            for source, samples in one.sources().items():
                tracks.append(track_row(name, source, matching(one, samples, Path(scratch))))
    counted = Counter[str]()
    for one in runs.values():
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
        box_table(runs.values(), cache),
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
