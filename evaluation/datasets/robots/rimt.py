"""RIMT: up to three people in a flat with motion capture, seen from a driving robot.

    Manually_annotated_bags/*.bag: /head_camera/..., /odom, /tf, /tf_static, /3D_ground_truth_N

ROS 1 bags. Each person has a topic of the truth: stamped positions. It has gaps where the person is
out of view or motion capture failed. Only frames with the position of a person are evaluated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from common.io.recording import open_recording
from common.io.ros_bag import open_bag
from evaluation.datasets.dataset import Dataset, DatasetJob, SequenceResult
from evaluation.datasets.robots.rgbd import detected
from evaluation.recordings.ground_truth import SampledTruth, TruthFrame
from evaluation.recordings.recordings import EvaluationRecording
from evaluation.run.run import EvaluationRun, execute, score_run
from people4d.messages import F64, Detections, TruthPerson

FOLDER = "Manually_annotated_bags"
TRUTH = "/3D_ground_truth_"
COLOUR, DEPTH = "/head_camera/rgb/image_rect_color", "/head_camera/depth/image_rect"
GAP_S = 0.2  # [s] maximum time between two positions that are interpolated
Path3D = tuple[F64, F64]  # times [s] (N), positions [m] (Nx3)


@dataclass(frozen=True, kw_only=True)
class RimtDataset(Dataset):
    """The seven annotated sequences of RIMT."""

    def sequences(self, folder: Path) -> Sequence[str]:
        """Return the annotated bags."""
        self.require(folder / FOLDER)
        found = sorted((folder / FOLDER).glob("*.bag"))
        if not found:
            self.require(folder / FOLDER / "SEQUENCE.bag")
        return [str(path.relative_to(folder)) for path in found]

    def evaluate(self, job: DatasetJob) -> SequenceResult:
        """Track people in 3D."""
        frame_id, people = self._read(job.path)
        options = {"colour_topic": COLOUR, "depth_topic": DEPTH, "map_frame": frame_id}
        source = str(job.path)
        camera = msgspec.structs.replace(job.method.camera, source=source, options=options)
        found = detected(job, camera)
        recorded = open_recording(found.detections).messages(Detections)
        stamps_ns = [message.stamp_ns for _, message in recorded]
        self._check_clock(job.path, people, np.array(stamps_ns) / 1e9)
        run = EvaluationRun(
            method=job.method,
            recording=EvaluationRecording(job.path.stem, job.path.stem, job.path),
            detections=found.detections,
            embeddings=next(iter(found.embeddings), None),
            truth=sampled(people, stamps_ns),
        )
        return SequenceResult(score_run(run, execute(run)).scores)

    def _read(self, path: Path) -> tuple[str, dict[str, Path3D]]:
        """Return the frame of the truth, and the path of each person."""
        rows: dict[str, list[tuple[float, ...]]] = {}
        frames = set[str]()
        with open_bag(path, {}) as bag:
            topics = [topic for topic in bag.types if topic.startswith(TRUTH)]
            if not topics:
                raise self.mismatch(path, f"topics {TRUTH}N", ", ".join(sorted(bag.types)))
            for topic, _, message in bag.messages(topics):
                try:
                    stamp, point = message.header.stamp, position_of(message)
                except AttributeError as error:
                    kind = bag.types[topic]
                    raise self.mismatch(path, f"stamped positions on {topic}", kind) from error
                frames.add(message.header.frame_id.strip("/"))
                time_s = stamp.sec + stamp.nanosec / 1e9
                rows.setdefault(topic.removeprefix(TRUTH), []).append((time_s, *point))
        if len(frames) != 1:
            raise self.mismatch(path, "truth in one frame", ", ".join(sorted(frames)) or "none")
        tables = {name: np.array(sorted(found)) for name, found in sorted(rows.items())}
        return frames.pop(), {name: (t[:, 0], t[:, 1:]) for name, t in tables.items()}

    def _check_clock(self, path: Path, people: Mapping[str, Path3D], times_s: F64) -> None:
        starts, ends = zip(*((t[0], t[-1]) for t, _ in people.values()), strict=True)
        if not len(times_s) or max(ends) < times_s[0] or min(starts) > times_s[-1]:
            frames = f"{times_s[0]:.3f} to {times_s[-1]:.3f} s" if len(times_s) else "no frames"
            got = f"truth from {min(starts):.3f} to {max(ends):.3f} s"
            raise self.mismatch(path, f"truth in the time of the images, {frames}", got)


RIMT = RimtDataset(
    title="RIMT",
    layout="https://github.com/socrob/RIMT-Dataset",
    licence="none stated",
    obtain="Follow the link on https://github.com/socrob/RIMT-Dataset, and name the folder with "
    f"{FOLDER}.",
    metric="MOTA, IDF1 and HOTA on the ground within 1 m; the authors publish no tool",
    server="",
    preset="best",
    columns=("mota", "idf1", "hota", "position_rmse_x_m", "position_rmse_y_m"),
    tuning=(),
)


def position_of(message: Any) -> tuple[float, float, float]:
    """Return the position of a stamped point, transform, pose or odometry, or AttributeError."""
    for name in ("point", "transform", "translation", "pose", "pose", "position"):
        message = getattr(message, name, message)
    return float(message.x), float(message.y), float(message.z)


def sampled(people: Mapping[str, Path3D], stamps_ns: Sequence[int]) -> SampledTruth:
    """Return the people at the stamps of frames; None without a known position."""
    frames: list[TruthFrame | None] = []
    for stamp_ns in stamps_ns:
        known = {name: at(path, stamp_ns / 1e9) for name, path in people.items()}
        here = tuple(
            TruthPerson(
                id=name, position_m=position_m, velocity_mps=None, yaw_rad=None, path_yaw_rad=None
            )
            for name, position_m in known.items()
            if position_m is not None
        )
        frames.append(TruthFrame(here, frozenset(one.id for one in here)) if here else None)
    return SampledTruth("map", tuple(people), tuple(frames))


def at(path: Path3D, time_s: float) -> F64 | None:
    """Return an interpolated position, None in a gap."""
    times_s, positions_m = path
    before, after = np.searchsorted(times_s, time_s, "right") - 1, np.searchsorted(times_s, time_s)
    if before < 0 or after == len(times_s) or times_s[after] - times_s[before] > GAP_S:
        return None
    return np.array([np.interp(time_s, times_s, column) for column in positions_m.T])
