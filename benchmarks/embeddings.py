"""Embedders on real people: can they tell who is who, beside the same question in the lab.

The marks are those of `real_people`; the recording shows identifiable people and is not part of the
repository: `--shared` names the folder that holds it.
"""

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.stats import rankdata

from benchmarks.lib.marks.methods import HALF_FRAME, MARKS, ROOT
from benchmarks.lib.table import markdown, write
from benchmarks.reid_threshold import INPUTS, SCENARIOS, images_of
from common.inference.onnx import OnnxSession
from common.metrics.record import GroundTruth, Hypotheses
from evaluation.methods import read_method
from evaluation.pipeline import lockstep, play
from evaluation.recordings.hand_annotations import FPS, crossing_camera
from evaluation.recordings.hand_marks import Mark, read_frames
from evaluation.recordings.mark_scores import on_marks
from people4d.messages import F32, F64, Crop, Crops, Detections
from services.detector.build import build as build_detector
from services.reid.config import ReidConfig
from services.reid.embedders import Embedder, load_embedder
from services.reid.osnet import OsnetEmbedder
from services.tracker.strongsort3d.config import COSINE_DISTANCE_MAX

APART_S = 2.0  # crops of one person compare when at least this far apart
FALSE_MATCHES = 0.05  # share of different people at whose distance the matches are counted
LAB_FRAMES = 12  # of each scenario
HALVES = {"first half": (0, HALF_FRAME), "second half": (HALF_FRAME, 10_000)}


@dataclass(frozen=True)
class PersonCrop:
    """A crop of a known person."""

    person: str
    time_s: float
    mostly_hidden: bool
    crop: Crop


@dataclass(frozen=True)
class PairScores:
    """Separation of the same from different people."""

    same: int  # pairs of crops of one person, some time apart
    rank1: float  # share of crops whose nearest crop, some time apart, shows the same person
    auc: float  # chance that two crops of one person are nearer than two of different people
    d_prime: float  # distance of both means in standard deviations
    matches: float  # share of pairs of one person nearer than FALSE_MATCHES of the others
    at_limit: tuple[float, float]  # shares of both kinds within C_cos

    def row(self) -> list[str]:
        """Return the scores as text."""
        true, false = self.at_limit
        return [
            str(self.same),
            f"{self.rank1:.2f}",
            f"{self.auc:.3f}",
            f"{self.d_prime:.2f}",
            f"{self.matches:.2f}",
            f"{true:.2f} / {false:.2f}",
        ]


def real_crops(shared: Path, model: str) -> Iterator[PersonCrop]:
    """Yield the crops of the people who are marked and detected."""
    settings = [f"detector.model={model}"] if model else []
    nodes = [build_detector(read_method("best", settings).detector)]
    marks, frame = read_frames(MARKS / "filinha.json"), -1
    for step in play(lockstep(crossing_camera(shared)), nodes):
        found = [m for m in step.messages if isinstance(m, Detections)]
        crops = [c for m in step.messages if isinstance(m, Crops) for c in m.crops]
        frame += len(found)
        people = marks.get(frame, ())
        if found and people and crops:
            for mark, index in matched(people, found[0]):
                crop = next((c for c in crops if c.detection == index), None)
                if crop is not None:
                    hidden = mark.visibility == "mostly"
                    yield PersonCrop(mark.person, frame / FPS, hidden, crop)


def matched(people: Sequence[Mark], found: Detections) -> Iterator[tuple[Mark, int]]:
    """Yield the marks with the index of the detection on each."""
    points = np.array([(m.u_px, m.v_px, m.u_px, m.v_px) for m in people], np.float64)
    boxes = np.array([d.box_xyxy_px for d in found.detections], np.float64).reshape(-1, 4)
    similarity = on_marks(
        GroundTruth(
            ids=tuple(m.person for m in people), boxes_xyxy_px=np.array(points, np.float64)
        ),
        Hypotheses(ids=tuple(range(len(boxes))), boxes_xyxy_px=boxes),
    )
    for i, j in np.argwhere(similarity > 0).tolist():
        yield people[i], j


def score(vectors: F32, crops: Sequence[PersonCrop], limit: float) -> PairScores:
    """Return the scores of an embedder on crops."""
    distances = 1 - (vectors @ vectors.T).astype(np.float64)
    times = np.array([crop.time_s for crop in crops])
    people = np.array([crop.person for crop in crops])
    apart = np.abs(times[:, None] - times) > APART_S
    same = people[:, None] == people
    upper = np.triu(np.ones_like(same), 1)
    own, others = distances[upper & same & apart], distances[upper & ~same]
    asked = (same & apart).any(axis=1)
    nearest = np.where(apart, distances, np.inf).argmin(axis=1)
    hits = same[np.arange(len(people)), nearest][asked]
    at_limit = np.quantile(others, FALSE_MATCHES)
    return PairScores(
        same=len(own),
        rank1=float(hits.mean()),
        auc=area_under_curve(own, others),
        d_prime=float((others.mean() - own.mean()) / np.sqrt((own.var() + others.var()) / 2)),
        matches=float((own <= at_limit).mean()),
        at_limit=(float((own <= limit).mean()), float((others <= limit).mean())),
    )


def area_under_curve(own: F64, others: F64) -> float:
    """Return the chance that one of the first values is below one of the second."""
    ranks = rankdata(np.concatenate([own, others]))[: len(own)]
    above = ranks.sum() - len(own) * (len(own) + 1) / 2
    return float(1 - above / (len(own) * len(others)))


def lab_crops() -> list[PersonCrop]:
    """Return crops of simulated people with a box and noisy keypoints; a scenario is a day."""
    return [
        PersonCrop(image.identity, image.time_s + 1000 * day, False, image.crops[kind])
        for day, name in enumerate(SCENARIOS)
        for image in images_of(name, LAB_FRAMES)
        for kind in [INPUTS.index("box and keypoints")]
    ]


def milliseconds(embedder: Embedder, crops: Sequence[PersonCrop]) -> float:
    """Return the median time of one crop."""
    took = []
    for crop in crops[:100]:
        start_ns = time.perf_counter_ns()
        embedder.embed([crop.crop])
        took.append((time.perf_counter_ns() - start_ns) / 1e6)
    return float(np.median(took))


def main() -> None:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    parser.add_argument("--lab", action="store_true", help="people of the lab, too: takes minutes")
    flags = parser.parse_args()
    cv2.setNumThreads(1)
    models = flags.shared / "data" / "models"
    detectors = {"MoveNet": "", "YOLOv8n-pose": str(models / "yolov8n-pose_640.onnx")}
    embedders = [
        load_embedder(ReidConfig(embedder="histogram")),
        load_embedder(ReidConfig(embedder="appearance")),
        OsnetEmbedder(OnnxSession(models / "osnet_x0_25_msmt17.onnx")),
    ]
    lab = lab_crops() if flags.lab else []
    rows, speeds = list[list[str]](), list[list[str]]()
    for detector, model in detectors.items():
        crops = list(real_crops(flags.shared, model))
        for embedder in embedders:
            limit = COSINE_DISTANCE_MAX[embedder.name]
            vectors = embedder.embed([crop.crop for crop in crops])
            for half, (first, last) in HALVES.items():
                for hidden in ("all", "not mostly hidden"):
                    chosen = [
                        k
                        for k, crop in enumerate(crops)
                        if first <= round(crop.time_s * FPS) < last
                        and not (crop.mostly_hidden and hidden != "all")
                    ]
                    scores = score(vectors[chosen], [crops[k] for k in chosen], limit)
                    rows.append([detector, half, hidden, embedder.name, *scores.row()])
            if not model:
                speeds.append([embedder.name, f"{milliseconds(embedder, crops):.2f}"])
    for embedder in embedders if lab else []:
        limit = COSINE_DISTANCE_MAX[embedder.name]
        scores = score(embedder.embed([crop.crop for crop in lab]), lab, limit)
        rows.append(["truth with noise", "lab", "none", embedder.name, *scores.row()])
    write(
        __file__,
        "Embedders on real people",
        NOTE,
        markdown(HEADER, sorted(rows)),
        "## Time\n\nMedian of one person, crops of MoveNet one by one, one thread.",
        markdown(["embedder", "ms"], speeds),
    )


HEADER = [
    *("detector", "frames", "people", "embedder", "pairs of one person", "rank 1", "AUC", "d'"),
    *(f"matches at {FALSE_MATCHES:.0%} false", "C_cos: true / false"),
]
NOTE = (
    "Crops of the six people of `real_people`, as the detector cuts them, with the identity from "
    f"marks made by hand; frames before {HALF_FRAME} are for choosing, the others for judging. "
    f"Crops of one person compare when more than {APART_S:.0f} s apart. No embedder was trained "
    "on these people: `appearance` learned from simulated people only, `osnet` from pictures of "
    "others. The lab's people are its cast, whose outfits `appearance` did not learn from."
)

if __name__ == "__main__":
    main()
