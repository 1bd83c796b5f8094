"""KITTI tracking, class pedestrian: public detections, boxes in the image, odometry of the car.

    SPLIT/det_02/NNNN.txt, oxts/NNNN.txt, label_02/NNNN.txt (training)

A line of labels and detections holds frame (from 0), identity, class, truncation, occlusion,
alpha, left, top, right, bottom, seven numbers in 3D, and in detections a score. A line of oxts is a
frame: its columns 4 to 6 are roll, pitch and yaw of the car.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from common.io.files import read_text
from common.metrics.mot_text import MAX_BYTES
from evaluation.datasets.boxes import BoxSequence, BoxTruth, track_boxes
from evaluation.datasets.dataset import Dataset, DatasetJob, SequenceResult
from people4d.errors import SourceError
from people4d.messages import F64
from services.tracker.image_sort.camera_turn import CameraDirection, camera_direction, turn_between
from services.tracker.image_sort.image_sort import BoxFrame, BoxTracks

PERIOD_NS = 100_000_000
# [px] Size of most images, and field of view; focal lengths of sequences differ by 2 %
SIZE_PX, FOV_DEG = (1242, 375), 81.4
# Limits of TrackEval's Kitti2DBox
OCCLUSION_MAX, TRUNCATION_MAX, HEIGHT_MIN_PX = 2, 0, 25.0
# Sequences of TrackEval's validation split, on which no setting is chosen
VALIDATION = (1, 6, 8, 10, 12, 13, 14, 15, 16, 18, 19)
BOX = slice(6, 10)


@dataclass(frozen=True, kw_only=True)
class KittiTracking(Dataset):
    """The tracking benchmark of KITTI."""

    def sequences(self, folder: Path) -> Sequence[str]:
        """Return the sequences with detections."""
        found = sorted(folder.glob("*/det_02/*.txt"))
        if not found:
            self.require(folder / "training" / "det_02" / "0000.txt")
        for path in found:
            split = path.parents[1]
            parts = ["oxts", *(["label_02"] if split.name == "training" else [])]
            self.require(*(split / part / path.name for part in parts))
        return [f"{path.parents[1].name}/{path.stem}" for path in found]

    def evaluate(self, job: DatasetJob) -> SequenceResult:
        """Track public detections."""
        one = self.load(job.folder, job.sequence)
        tracks = track_boxes(job.method, one.frames)
        figures = None if one.truth is None else one.score(tracks)
        return SequenceResult(figures, {f"{job.sequence}.txt": submission(tracks)})

    def load(self, folder: Path, sequence: str) -> BoxSequence:
        """Read a sequence; SourceError if a file has another layout, or too many frames."""
        split, name = sequence.split("/")
        poses = self._directions(folder / split / "oxts" / f"{name}.txt")
        found = self._rows(folder / split / "det_02" / f"{name}.txt", 18, len(poses))
        frames, before = [], None
        for number, direction in enumerate(poses):
            people = [row for row in found[number] if row[2].lower() == "pedestrian"]
            boxes, scores = _boxes(people), np.array([float(row[17]) for row in people])
            turn, before = turn_between(before, direction), direction
            stamp_ns = number * PERIOD_NS
            frames.append(BoxFrame(stamp_ns, boxes, scores, SIZE_PX, turn, FOV_DEG))
        labels = folder / split / "label_02" / f"{name}.txt"
        if not labels.exists():
            return BoxSequence(name, tuple(frames), None)
        truth = map(_truth, self._rows(labels, 17, len(poses)))
        return BoxSequence(name, tuple(frames), tuple(truth))

    def _rows(self, path: Path, columns: int, frames: int) -> list[list[list[str]]]:
        """Return the lines of each frame, in words."""
        rows: list[list[list[str]]] = [[] for _ in range(frames)]
        for number, row in enumerate(self._lines(path), 1):
            where = Path(f"{path}, line {number}")
            if len(row) != columns or not row[0].isdecimal() or not _finite(row[1:2] + row[3:]):
                expected = f"{columns} columns, a frame first, and numbers except the class"
                raise self.mismatch(where, expected, " ".join(row)[:60])
            if int(row[0]) >= frames:
                raise self.mismatch(
                    where, f"frames 0 to {frames - 1} as in oxts", f"frame {row[0]}"
                )
            rows[int(row[0])].append(row)
        return rows

    def _directions(self, path: Path) -> list[CameraDirection | None]:
        directions = []
        for row in self._lines(path):
            if len(row) != 30 or not _finite(row):
                raise self.mismatch(path, "30 columns of numbers", " ".join(row)[:60])
            rotation = rotation_from_rpy(*map(float, row[3:6]))
            pose = transform_from(np.zeros(3), rotation) @ LINK_FROM_OPTICAL
            directions.append(camera_direction(pose))
        return directions

    def _lines(self, path: Path) -> Iterator[list[str]]:
        try:
            yield from (line.split() for line in read_text(path, MAX_BYTES).splitlines() if line)
        except (OSError, ValueError) as error:
            raise SourceError(f"{path} cannot be read: {error}", self.obtain) from error


def _truth(rows: list[list[str]]) -> BoxTruth:
    people = [row for row in rows if row[2].lower() in ("pedestrian", "person") and row[1] != "-1"]
    clear = np.array(
        [float(r[3]) <= TRUNCATION_MAX and float(r[4]) <= OCCLUSION_MAX for r in people], np.bool_
    )
    evaluated = clear & np.array([row[2].lower() == "pedestrian" for row in people], np.bool_)
    regions = _boxes([row for row in rows if row[2].lower() == "dontcare"])
    ids = tuple(int(float(row[1])) for row in people)
    return BoxTruth(ids, _boxes(people), evaluated, ~evaluated, regions, HEIGHT_MIN_PX)


def _finite(words: list[str]) -> bool:
    try:
        return all(math.isfinite(float(word)) for word in words)
    except ValueError:
        return False


def _boxes(rows: list[list[str]]) -> F64:
    return np.array([row[BOX] for row in rows], np.float64).reshape(-1, 4)


def submission(tracks: Iterable[BoxTracks]) -> str:
    """Return the tracks of each frame as the server expects them."""
    unknown = "-1 -1 -1 -1000 -1000 -1000 -10"
    return "".join(
        f"{number} {one} Pedestrian -1 -1 -10 {' '.join(f'{x:.2f}' for x in box)} {unknown} 1\n"
        for number, found in enumerate(tracks)
        for one, box in zip(found.ids.tolist(), found.boxes_xyxy_px.tolist(), strict=True)
    )


KITTI = KittiTracking(
    title="KITTI tracking",
    layout="https://www.cvlibs.net/datasets/kitti/eval_tracking.php",
    licence="CC BY-NC-SA 3.0",
    obtain="Get labels, GPS/IMU data and L-SVM or regionlet detections of "
    "https://www.cvlibs.net/datasets/kitti/eval_tracking.php, and name the folder of training.",
    metric="HOTA, MOTA, IDF1 of pedestrians as TrackEval's Kitti2DBox",
    server="SPLIT/NNNN.txt: frame, id, Pedestrian and 15 more columns of the devkit",
    preset="image-sort-odom-dynamic",
    columns=("hota", "mota", "idf1", "id_switches"),
    tuning=tuple(f"training/{n:04}" for n in range(21) if n not in VALIDATION),
)
