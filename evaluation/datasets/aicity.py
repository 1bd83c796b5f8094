"""AI City Challenge 2025 and 2026, track 1: people before many cameras with depth, as 3D boxes.

    SPLIT/SCENE/calibration.json, ground_truth.json (train and val), videos/CAMERA.mp4,
    depth_maps/CAMERA.h5 with distance_to_image_plane_00000.png and so on, in millimetres

All cameras of a scene are in step. Boxes have a centre, width, length, height and yaw in the world,
in metres and radians. The server ranks all classes; only people are tracked here.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import msgspec
import numpy as np

from common.metrics.from_messages import hypotheses_of
from common.metrics.record import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from common.metrics.scores import Scores, score
from evaluation.datasets.aicity_files import (
    PERIOD_NS,
    AiCityCalibration,
    Depths,
    Truth,
    open_hdf5,
    read_frames,
    read_json,
    read_truth,
)
from evaluation.datasets.boxes_3d import Overlap3d, boxes_of
from evaluation.datasets.dataset import Dataset, DatasetJob, SequenceResult
from evaluation.methods import Method
from evaluation.pipeline import track_again
from people4d.messages import Crops, Message, RgbdFrame, Track
from services.detector.build import build as build_detector
from services.reid.build import build as build_reid

SIZE_M = (0.6, 0.6, 1.75)  # [m] width, length and height of all tracks


@dataclass(frozen=True, kw_only=True)
class AiCityTrack1(Dataset):
    """Scenes of many cameras."""

    depths: Depths = open_hdf5

    def sequences(self, folder: Path) -> Sequence[str]:
        """Return the scenes."""
        found = sorted(folder.glob("*/*/calibration.json"))
        if not found:
            self.require(folder / "train" / "Warehouse_000" / "calibration.json")
        for path in found:
            if not path.parents[1].name.startswith("test"):
                self.require(path.with_name("ground_truth.json"))
            for sensor in read_json(self, path, AiCityCalibration).sensors:
                self.require(path.parent / "videos" / f"{sensor.id}.mp4")
                self.require(path.parent / "depth_maps" / f"{sensor.id}.h5")
        return [str(path.parent.relative_to(folder)) for path in found]

    def evaluate(self, job: DatasetJob) -> SequenceResult:
        """Track the people before all cameras of a scene together."""
        config = msgspec.structs.replace(
            job.method.tracker, frame_id="map", embedding_wait_s=0.0, reorder_wait_s=0.0
        )
        messages = list(self.detections(job.path, job.method))
        frames = 1 + max(m.stamp_ns for m in messages) // PERIOD_NS
        # The last answer to a frame knows all its cameras.
        found = {m.stamp_ns // PERIOD_NS: m for m in track_again(messages, config)}
        tracks = [_boxes(found[k].tracks if k in found else ()) for k in range(frames)]
        files = {f"{job.path.parent.name}/track1.txt": submission(job.path.name, tracks)}
        truth = read_truth(self, job.path, frames)
        return SequenceResult(None if truth is None else _score(truth, tracks), files)

    def detections(self, folder: Path, method: Method) -> Iterator[Message]:
        """Yield calibrations and poses, then detections and embeddings, frame by frame."""
        sensors = read_json(self, folder / "calibration.json", AiCityCalibration).sensors
        streams = [read_frames(self, self.depths, folder, sensor) for sensor in sensors]
        detectors = [build_detector(method.detector) for _ in sensors]
        embedder = build_reid(method.reid) if method.reid else None
        for group in zip_longest(*streams):
            if None in group:
                got = f"fewer of {sensors[group.index(None)].id}"
                raise self.mismatch(folder / "videos", "the same number of frames of each", got)
            for detector, message in zip(detectors, group, strict=True):
                if not isinstance(message, RgbdFrame):
                    yield message
                for answer in detector.handle(message, 0):
                    if not isinstance(answer, Crops):
                        yield answer
                    elif embedder:
                        yield from embedder.handle(answer, 0)


def submission(scene: str, tracks: Sequence[Hypotheses]) -> str:
    """Return the lines of a scene in track1.txt: its number is the end of its name."""
    number, size = int(scene.rpartition("_")[2]), " ".join(f"{x:g}" for x in SIZE_M)
    return "".join(
        f"{number} 0 {one} {frame} {x:.2f} {y:.2f} {z:.2f} {size} {yaw_rad:.2f}\n"
        for frame, found in enumerate(tracks)
        for one, ((x, y, z), yaw_rad) in zip(found.ids, boxes_of(found), strict=True)
    )


def _boxes(tracks: Iterable[Track]) -> Hypotheses:
    """Return the boxes of tracks: as high as people are, on the floor."""
    found = hypotheses_of(tracks)
    centres_m = np.zeros((0, 3)) if found.positions_m is None else found.positions_m.copy()
    centres_m[:, 2] = SIZE_M[2] / 2
    return Hypotheses(ids=found.ids, positions_m=centres_m, yaws_rad=found.yaws_rad)


def _score(truth: Truth, tracks: Sequence[Hypotheses]) -> Scores:
    sizes_m = {one.id: np.array(one.size_m) for people in truth for one in people}
    frames = tuple(
        EvaluationFrame(
            stamp_ns=number * PERIOD_NS,
            truth=GroundTruth(
                ids=tuple(one.id for one in people),
                positions_m=np.array([one.centre_m for one in people]).reshape(-1, 3),
                yaws_rad=np.array([one.rotation_rad[2] for one in people]),
            ),
            hypotheses=found,
        )
        for number, (people, found) in enumerate(zip(truth, tracks, strict=True))
    )
    return score(EvaluationSequence("scene", frames), Overlap3d(sizes_m, SIZE_M))


AI_CITY = AiCityTrack1(
    title="AI City track 1",
    layout="https://www.aicitychallenge.org/2025-track1",
    licence="CC BY 4.0",
    obtain="Get MTMC_Tracking_2025 of PhysicalAI-SmartSpaces with its depth maps "
    "(https://www.aicitychallenge.org/2025-track1), and name its folder.",
    metric="3D HOTA of people by overlap of boxes with yaw; the server's tool is not public",
    server="track1.txt of a split: scene, 0, id, frame, x, y, z, width, length, height, yaw",
    preset="best",
    columns=("hota", "det_a", "ass_a", "id_switches"),
    tuning=("train/*",),
)
