"""Cosine distances between pictures of the same and of different people, per embedder."""

import argparse
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.table import markdown, write
from common.inference import OnnxSession
from common.messages import F32, F64, U8, Crop
from services.detector.crops import crop_person
from services.detector.models import InstanceMask, Person
from services.reid import histogram, osnet
from services.reid.embedder import Embedder
from services.reid.histogram import HistogramEmbedder
from services.reid.osnet import OsnetEmbedder

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
IDENTITIES = {"two": "ab", "robot": "ad"}  # the same man is in both rooms
STEP = 5  # every so many frames
VISIBLE_MIN = 0.8  # share of the person that is seen
NOISE_PX = 3.0  # standard deviation of the keypoints, as of a good detector
APART_S = 1.0  # pictures of one person compare when at least this far apart
FALSE_MATCHES = 0.02  # share of different people that the limit lets pass
INPUTS = ("box", "box and keypoints", "box, keypoints and mask")


@dataclass(frozen=True)
class Picture:
    """One person in one frame."""

    identity: str
    room: str
    time_s: float
    crops: tuple[Crop, ...]  # one for each of INPUTS


def read(lab: Path, room: str) -> list[Picture]:
    """Return the pictures of one sequence."""
    truth = np.load(lab / room / "gt.npz")
    rng = np.random.default_rng(0)
    pictures = []
    for frame, person in itertools.product(range(0, len(truth["t"]), STEP), range(2)):
        if truth["vis"][frame, person] < VISIBLE_MIN:
            continue
        rgb = cv2.imread(str(lab / room / "rgb" / f"{frame:05d}.jpg"), cv2.IMREAD_COLOR_RGB)
        noise = rng.normal(0, NOISE_PX, (17, 2))
        keypoints = np.ones((17, 3), np.float32)
        keypoints[:, :2] = truth["kp2d"][frame, person] + noise
        mask = (truth["masks"][frame] == person + 1).astype(np.uint8)
        crops = cut(np.asarray(rgb, np.uint8), truth["bbox"][frame, person], keypoints, mask)
        time_s = float(truth["t"][frame])
        pictures.append(Picture(IDENTITIES[room][person], room, time_s, crops))
    return pictures


def cut(rgb: U8, box: F32, keypoints: F32, mask: U8) -> tuple[Crop, ...]:
    """Return the crops for each of INPUTS."""
    people = (
        Person(1.0, box),
        Person(1.0, box, keypoints),
        Person(1.0, box, keypoints, InstanceMask(mask, 0, 0)),
    )
    crops = [crop_person(0, person, rgb, 256) for person in people]
    return tuple(crop for crop in crops if crop is not None)


def distances(vectors: F32, pictures: Sequence[Picture]) -> tuple[F64, F64, F64]:
    """Return distances of one person in one room, of one in two rooms, and of two people."""
    same, moved, different = [], [], []
    for a, b in itertools.combinations(range(len(pictures)), 2):
        distance = 1 - float(vectors[a] @ vectors[b])
        first, second = pictures[a], pictures[b]
        if first.identity != second.identity:
            different.append(distance)
        elif first.room != second.room:
            moved.append(distance)
        elif abs(first.time_s - second.time_s) >= APART_S:
            same.append(distance)
    return np.array(same), np.array(moved), np.array(different)


def row(name: str, kind: str, limit: float, groups: tuple[F64, F64, F64]) -> list[str]:
    """Return one line of the table."""
    same, moved, different = groups
    at_limit = float(np.quantile(different, FALSE_MATCHES))
    both = np.concatenate([same, moved])
    return [
        name,
        kind,
        " / ".join(f"{np.quantile(same, q):.2f}" for q in (0.5, 0.95, 0.99)),
        " / ".join(f"{np.quantile(moved, q):.2f}" for q in (0.5, 0.95, 0.99)),
        " / ".join(f"{np.quantile(different, q):.2f}" for q in (0.0, 0.02, 0.5)),
        f"{at_limit:.2f}",
        f"{np.mean(both <= at_limit):.3f}",
        f"{limit:.2f}: {np.mean(both <= limit):.3f} / {np.mean(different <= limit):.3f}",
    ]


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lab", type=Path, default=SHARED / "lab", help="folder of the sequences")
    weights = SHARED / "models" / "osnet_x0_25_msmt17.onnx"
    parser.add_argument("--osnet", type=Path, default=weights, help="OSNet's .onnx file")
    flags = parser.parse_args()
    pictures = [picture for room in IDENTITIES for picture in read(flags.lab, room)]
    embedders: list[tuple[Embedder, Sequence[int], float]] = [
        (HistogramEmbedder(), (0, 1, 2), histogram.COSINE_DISTANCE_MAX),
        (OsnetEmbedder(OnnxSession(flags.osnet)), (0,), osnet.COSINE_DISTANCE_MAX),
    ]
    rows = []
    for embedder, kinds, limit in embedders:
        for kind in kinds:
            vectors = embedder.embed([picture.crops[kind] for picture in pictures])
            groups = distances(vectors, pictures)
            rows.append(row(embedder.name, INPUTS[kind], limit, groups))
    header = [
        "embedder",
        "input",
        "same person, same room: p50 / p95 / p99",
        "same person, other room: p50 / p95 / p99",
        "different people: min / p2 / p50",
        f"limit at {FALSE_MATCHES:.0%} false matches",
        "true matches there",
        "C_cos: true / false matches",
    ]
    write(
        __file__,
        "Re-identification: cosine distance of the same and of different people",
        f"{len(pictures)} pictures of three simulated people, one of them in two rooms, at least "
        f"{VISIBLE_MIN:.0%} visible; boxes, keypoints ({NOISE_PX:.0f} px noise) and masks from "
        f"truth; pictures of one person at least {APART_S:.0f} s apart.",
        markdown(header, rows),
        "Three people who dress differently are an easy test: these figures say that the "
        "embedders work and where the limit of a gate belongs, not how well they tell people in "
        "the same clothes apart.",
    )


if __name__ == "__main__":
    main()
