"""TPT-Bench: one person followed through crowds, in panoramic images of a pushed robot.

    GTs/SEQUENCE.json: {"TIME": {"is_exist": true, "bbox": [left, top, width, height]}, ...}
    panoramic_images/SEQUENCE/TIME.jpg

Times are in nanoseconds. The panoramas have no depth, so only trackers of boxes run. The target is
the track on the true box of the first image that shows the person, and no other track.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import msgspec
import numpy as np

from common.geometry.boxes import iou_xyxy
from common.io.files import read_bytes
from common.io.images import decode_image
from evaluation.datasets.boxes import track_boxes
from evaluation.datasets.dataset import Dataset, DatasetJob, SequenceResult
from evaluation.datasets.robots.target_scores import ABSENT, Answer, TargetTruth, corners, score
from people4d.errors import SourceError
from services.detector.models.registry import load_model
from services.tracker.image_sort.image_sort import BoxFrame, BoxTracks

MAX_BYTES = 2**28
ON_TARGET = 0.3  # minimum overlap of the first track with the true box


@dataclass(frozen=True, kw_only=True)
class TptDataset(Dataset):
    """48 sequences, indoors and outdoors."""

    def sequences(self, folder: Path) -> Sequence[str]:
        """Return the sequences with truth."""
        self.require(folder / "GTs")
        found = sorted(path.stem for path in (folder / "GTs").glob("*.json"))
        if not found:
            self.require(folder / "GTs" / "0000.json")
        self.require(*(folder / "panoramic_images" / name for name in found))
        return found

    def evaluate(self, job: DatasetJob) -> SequenceResult:
        """Detect and track people in the panoramas, and follow the first target."""
        truth = self._read(job.folder / "GTs" / f"{job.sequence}.json")
        images = job.folder / "panoramic_images" / job.sequence
        self.require(*(images / f"{time}.jpg" for time in truth))
        model, frames = load_model(job.method.detector), []
        for time in truth:
            data = read_bytes(images / f"{time}.jpg", MAX_BYTES)
            rgb = decode_image(data, cv2.IMREAD_COLOR_RGB)
            people = model.detect(np.asarray(rgb, np.uint8))
            boxes = np.array([one.box_xyxy_px for one in people], np.float64).reshape(-1, 4)
            size_px = rgb.shape[1], rgb.shape[0]
            scores = np.array([one.score for one in people])
            frames.append(BoxFrame(int(time), boxes, scores, size_px))
        answers = follow(truth, track_boxes(job.method, frames))
        return SequenceResult(score(truth, answers), {f"{job.sequence}.json": submission(answers)})

    def _read(self, path: Path) -> dict[str, TargetTruth]:
        """Return the truth by time, in order."""
        try:
            found = msgspec.json.decode(read_bytes(path, MAX_BYTES), type=dict[str, TargetTruth])
            if not any(one.is_exist for one in found.values()):
                raise ValueError("no time at which the target exists")
            return {time: found[time] for time in sorted(found, key=int)}
        except (OSError, ValueError) as error:
            expected = "times with is_exist and bbox"
            raise SourceError(f"{path}: expected {expected}, got {error}", self.obtain) from error


TPT = TptDataset(
    title="TPT-Bench",
    layout="https://github.com/MedlarTea/TPT-BENCH-TOOLS",
    licence="CC BY 4.0",
    obtain="Follow https://github.com/MedlarTea/TPT-BENCH-TOOLS, and name the folder with GTs and "
    "panoramic_images.",
    metric="average overlap, F-score and largest recall at full precision as evaluate_baselines.py",
    server="SEQUENCE.json: target_info of each time: left, top, width, height, confidence",
    preset="image-sort-dynamic",
    columns=("ao", "f_score", "max_recall"),
    tuning=(),
)


def follow(truth: Mapping[str, TargetTruth], tracks: Sequence[BoxTracks]) -> dict[str, Answer]:
    """Return box and confidence of the target at each time."""
    target, answers = None, dict[str, Answer]()
    for (time, one), here in zip(truth.items(), tracks, strict=True):
        if target is None and one.is_exist and len(here.ids):
            overlaps = iou_xyxy(corners(one.bbox)[None], here.boxes_xyxy_px)[0]
            best = int(overlaps.argmax())
            target = int(here.ids[best]) if overlaps[best] >= ON_TARGET else None
        rows = np.flatnonzero(here.ids == target).tolist() if target else []
        answers[time] = ABSENT
        for row in rows:
            left, top, right, bottom = here.boxes_xyxy_px[row].tolist()
            answers[time] = left, top, right - left, bottom - top, float(here.scores[row])
    return answers


def submission(answers: Mapping[str, Answer]) -> str:
    """Return the answers as the tool reads them; it asks for other candidates, too."""
    return json.dumps(
        {t: {"target_info": a, "tracks_target_conf_bbox": []} for t, a in answers.items()}
    )
