"""MOT15, MOT17, MOT20 and DanceTrack: one layout, public detections, boxes in the image.

    SPLIT/SEQUENCE/seqinfo.ini, det/det.txt, gt/gt.txt (the last one not in test splits)

Since MOT16 columns 8 and 9 of the truth are class and visibility; TrackEval leaves out tracks on
annotated boxes of some classes, and evaluates pedestrians with a flag other than 0.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.metrics.mot_text import MotInfo, MotRows, read_info, read_rows
from evaluation.datasets.boxes import BoxSequence, BoxTruth, image_frame, track_boxes
from evaluation.datasets.dataset import Dataset, DatasetJob, SequenceResult
from people4d.errors import DecodeError, SourceError
from services.tracker.image_sort.image_sort import BoxTracks

PEDESTRIAN = 1
# Classes of neutral boxes: person on a vehicle, static person, distractor, reflection
NEUTRAL = (2, 7, 8, 12)
VEHICLE = 6  # neutral in MOT20, too


@dataclass(frozen=True, kw_only=True)
class MotDataset(Dataset):
    """A data set in the layout of the MOT-Challenge."""

    prefix: str  # beginning of the names of its sequences
    neutral: tuple[int, ...] = NEUTRAL
    has_classes: bool = True  # False: MOT15
    layout: str = "https://github.com/JonathonLuiten/TrackEval/tree/master/docs"
    licence: str = "CC BY-NC-SA 3.0"
    metric: str = "HOTA, MOTA, IDF1 as TrackEval's MotChallenge2DBox"
    server: str = "SEQUENCE.txt: frame, id, left, top, width, height, 1, -1, -1, -1"
    preset: str = "image-sort-dynamic"
    columns: tuple[str, ...] = ("hota", "mota", "idf1", "id_switches")
    tuning: tuple[str, ...] = ("train/*",)  # settings are chosen on no other split

    def sequences(self, folder: Path) -> Sequence[str]:
        """Return the sequences of all splits that are there, complete ones only."""
        found = sorted(folder.glob("*/*/seqinfo.ini"))
        if not found:
            self.require(folder / "train" / f"{self.prefix}..." / "seqinfo.ini")
        for file in found:
            if not file.parent.name.startswith(self.prefix):
                raise self.mismatch(file, f"a sequence {self.prefix}...", file.parent.name)
            self.require(file.parent / "det" / "det.txt")
            if not file.parents[1].name.startswith("test"):
                self.require(file.parent / "gt" / "gt.txt")
        return [str(file.parent.relative_to(folder)) for file in found]

    def evaluate(self, job: DatasetJob) -> SequenceResult:
        """Track public detections."""
        one = self.load(job.path)
        tracks = track_boxes(job.method, one.frames)
        figures = None if one.truth is None else one.score(tracks)
        return SequenceResult(figures, {f"{job.path.name}.txt": submission(tracks)})

    def load(self, folder: Path) -> BoxSequence:
        """Read a sequence; SourceError if a file has another layout, or too many frames."""
        truth_file = folder / "gt" / "gt.txt"
        try:
            info = read_info(folder / "seqinfo.ini")
            found = self._rows(folder / "det" / "det.txt", info)
            annotated = self._rows(truth_file, info) if truth_file.exists() else None
        except DecodeError as error:
            raise SourceError(error.problem, self.obtain) from error
        if annotated and self.has_classes and (annotated.classes == 0).any():
            raise self.mismatch(truth_file, "class and visibility in columns 8 and 9", "none")
        numbers = range(1, info.frames + 1)
        frames = tuple(image_frame(found.frame_rows(n), n, info) for n in numbers)
        truth = tuple(self._truth(annotated.frame_rows(n)) for n in numbers) if annotated else None
        return BoxSequence(info.name, frames, truth)

    def _rows(self, path: Path, info: MotInfo) -> MotRows:
        rows = read_rows(path)
        if len(rows.frames) and rows.frames[-1] > info.frames:
            raise self.mismatch(path, f"at most {info.frames} frames", f"frame {rows.frames[-1]}")
        return rows

    def _truth(self, rows: MotRows) -> BoxTruth:
        evaluated = rows.confidences != 0
        neutral = np.zeros(len(rows.ids), np.bool_)
        if self.has_classes:
            evaluated &= rows.classes == PEDESTRIAN
            neutral = np.isin(rows.classes, self.neutral)
        return BoxTruth(tuple(rows.ids.tolist()), rows.boxes_xyxy_px, evaluated, neutral)


MOT15 = MotDataset(
    title="MOT15",
    obtain="Get 2DMOT2015.zip of https://motchallenge.net/data/MOT15, and name its folder.",
    prefix="",
    has_classes=False,
    tuning=("*/ETH-Bahnhof", "*/TUD-Stadtmitte"),
)
MOT17 = MotDataset(
    title="MOT17",
    obtain="Get MOT17.zip of https://motchallenge.net/data/MOT17, and name its folder.",
    prefix="MOT17-",
)
MOT20 = MotDataset(
    title="MOT20",
    obtain="Get MOT20.zip of https://motchallenge.net/data/MOT20, and name its folder.",
    prefix="MOT20-",
    neutral=(*NEUTRAL, VEHICLE),
)
DANCETRACK = MotDataset(
    title="DanceTrack",
    layout="https://github.com/DanceTrack/DanceTrack",
    licence="annotations CC BY 4.0, videos for research only",
    obtain="Get it from https://dancetrack.github.io; it has no detections, so put yours into "
    "SEQUENCE/det/det.txt as in MOT17.",
    prefix="dancetrack",
)


def submission(tracks: Iterable[BoxTracks]) -> str:
    """Return the tracks of each frame as the server expects them."""
    lines = []
    for number, found in enumerate(tracks, 1):
        sizes = found.boxes_xyxy_px[:, 2:] - found.boxes_xyxy_px[:, :2]
        boxes = np.hstack([found.boxes_xyxy_px[:, :2], sizes])
        for one, box in zip(found.ids.tolist(), boxes.tolist(), strict=True):
            lines.append(f"{number},{one},{','.join(f'{x:.2f}' for x in box)},1,-1,-1,-1\n")
    return "".join(lines)
