"""JRDB 2D tracking: public detections on stitched images of a robot's surroundings; OSPA.

    SPLIT/detections/detections_2d_stitched/SEQUENCE.json: {"detections": {"000000.jpg": [...]}}
    SPLIT/labels/labels_2d_stitched/SEQUENCE.json: {"labels": {"000000.jpg": [...]}} (training)

An entry has `box` (left, top, width, height), `label_id` ("pedestrian:7"; detections "person:-1")
and `score` or `attributes`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from common.io.files import read_bytes
from common.metrics.mot_text import MAX_BYTES
from evaluation.datasets.boxes import BoxSequence, BoxTruth, track_boxes
from evaluation.datasets.dataset import Dataset, DatasetJob, SequenceResult
from evaluation.datasets.ospa import OspaFigures, ospa
from people4d.messages import F64
from services.tracker.image_sort.image_sort import BoxFrame, BoxTracks

PERIOD_NS = 1_000_000_000 // 15
SIZE_PX = (3760, 480)  # [px] stitched image
TRAINING = "train_dataset_with_activity"
FILES = {"detections": "detections/detections_2d_stitched", "labels": "labels/labels_2d_stitched"}
HIDDEN = "Fully_occluded"  # the toolkit evaluates less occluded people that are not truncated


class JrdbEntry(msgspec.Struct, frozen=True):
    """One box of an image."""

    box: tuple[float, float, float, float]  # [px] left, top, width, height
    label_id: str
    score: float = 0.0  # detections
    attributes: dict[str, Any] = {}  # labels

    @property
    def is_evaluated(self) -> bool:
        """True if the person must be tracked."""
        truncated = str(self.attributes.get("truncated")).lower() == "true"
        return self.attributes.get("occlusion") != HIDDEN and not truncated


Entries = list[JrdbEntry]


@dataclass(frozen=True, kw_only=True)
class JrdbTracking(Dataset):
    """The 2D tracking benchmark of JRDB."""

    def sequences(self, folder: Path) -> Sequence[str]:
        """Return the sequences with detections."""
        found = sorted(folder.glob(f"*/{FILES['detections']}/*.json"))
        if not found:
            self.require(folder / TRAINING / FILES["detections"] / "SEQUENCE.json")
        for path in found:
            split = path.parents[2]
            if split.name == TRAINING:
                self.require(split / FILES["labels"] / path.name)
        return [f"{path.parents[2].name}/{path.stem}" for path in found]

    def evaluate(self, job: DatasetJob) -> SequenceResult:
        """Track public detections."""
        one = self.load(job.folder, job.sequence)
        tracks = track_boxes(job.method, one.frames)
        split = f"{job.path.parent.name}/"
        others = [name for name in self.sequences(job.folder) if name.startswith(split)]
        files = {f"{split}{others.index(job.sequence):04}.txt": submission(tracks)}
        if one.truth is None:
            return SequenceResult(None, files)
        return SequenceResult(OspaFigures(one.score(tracks), ospa(one.truth, tracks)), files)

    def load(self, folder: Path, sequence: str) -> BoxSequence:
        """Read a sequence; SourceError if a file has another layout, or labels of other frames."""
        split, name = sequence.split("/")
        found = self._frames(folder / split / FILES["detections"] / f"{name}.json", "detections")
        frames = tuple(_frame(k, found[image]) for k, image in enumerate(sorted(found)))
        path = folder / split / FILES["labels"] / f"{name}.json"
        if not path.exists():
            return BoxSequence(name, frames, None)
        labels = self._frames(path, "labels")
        other = sorted(set(labels) - set(found))
        if other:
            raise self.mismatch(path, f"images of {FILES['detections']}", other[0])
        truth = tuple(_truth(labels.get(image, [])) for image in sorted(found))
        return BoxSequence(name, frames, truth)

    def _frames(self, path: Path, key: str) -> dict[str, Entries]:
        try:
            content = msgspec.json.decode(read_bytes(path, MAX_BYTES), type=dict[str, Any])
            return msgspec.convert(content.get(key), dict[str, Entries])
        except (OSError, msgspec.MsgspecError) as error:
            raise self.mismatch(path, f"{key} of images", error) from error


def submission(tracks: Iterable[BoxTracks]) -> str:
    """Return the tracks of each frame as the toolkit's samples hold them."""
    lines = []
    for number, found in enumerate(tracks):
        sizes = found.boxes_xyxy_px[:, 2:] - found.boxes_xyxy_px[:, :2]
        boxes = np.hstack([found.boxes_xyxy_px[:, :2], sizes]).tolist()
        for one, box, score in zip(found.ids.tolist(), boxes, found.scores.tolist(), strict=True):
            ltwh = " ".join(f"{x:.2f}" for x in box)
            lines.append(f"{number} {one} Pedestrian 0 0 -1 {ltwh} {'-1 ' * 7}{score:.2f}\n")
    return "".join(lines)


def _frame(number: int, entries: Entries) -> BoxFrame:
    scores = np.array([entry.score for entry in entries], np.float64)
    return BoxFrame(number * PERIOD_NS, _boxes(entries), scores, SIZE_PX)


def _truth(entries: Entries) -> BoxTruth:
    people = [entry for entry in entries if entry.label_id.startswith("pedestrian:")]
    flags = np.array([entry.is_evaluated for entry in people], np.bool_)
    ids = tuple(int(entry.label_id.partition(":")[2]) for entry in people)
    return BoxTruth(ids, _boxes(people), flags, np.zeros(len(ids), np.bool_))


def _boxes(entries: Entries) -> F64:
    ltwh = np.array([entry.box for entry in entries], np.float64).reshape(-1, 4)
    return np.hstack([ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]])


JRDB = JrdbTracking(
    title="JRDB",
    layout="https://github.com/JRDB-dataset/jrdb_toolkit",
    licence="CC BY-NC-SA 3.0",
    obtain="Get labels and detections of https://jrdb.erc.monash.edu, and name their folder.",
    metric="OSPA, HOTA, MOTA, IDF1 of 2D boxes as the toolkit's JRDB2DBox",
    server="SPLIT/NNNN.txt, sequences of a split by name: frame, id, Pedestrian and 15 more "
    "columns",
    preset="image-sort-dynamic",
    columns=("ospa", "hota", "mota", "idf1", "id_switches"),
    tuning=(f"{TRAINING}/*",),
)
