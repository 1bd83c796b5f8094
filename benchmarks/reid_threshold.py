"""Cosine distances between pictures of the same and of different people, per embedder."""

import argparse
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.lib.lab_frames import LabFrame, lab_frames
from benchmarks.lib.table import markdown, write
from common.inference.onnx import OnnxSession
from evaluation.recordings.rendered import inside
from lab.truth.frames import PersonView
from people4d.messages import F32, F64, U8, Crop
from services.detector.crops import crop_person
from services.detector.models.base import DetectedPerson, InstanceMask
from services.reid.config import ReidConfig
from services.reid.embedders import Embedder, load_embedder
from services.reid.osnet import OsnetEmbedder
from services.tracker.strongsort3d.config import COSINE_DISTANCE_MAX

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
SCENARIOS = ("three_crossing", "four_dense", "twins", "pmrm2", "port1")  # in two rooms
FRAMES = 40  # of each
VISIBLE_MIN = 0.8  # share of the person that is seen
NOISE_PX = 3.0  # standard deviation of the keypoints, as of a good detector
APART_S = 1.0  # pictures of one person compare when at least this far apart
FALSE_MATCHES = 0.02  # share of different people that the limit lets pass
INPUTS = ("box", "box and keypoints", "box, keypoints and mask")
ALIKE = {"twin_a", "twin_b"}  # two people dressed alike


@dataclass(frozen=True)
class PersonImage:
    """One person in one frame."""

    identity: str
    scenario: str
    time_s: float
    crops: tuple[Crop, ...]  # one for each of INPUTS


@dataclass
class Distances:
    """Cosine distances of pairs of pictures, by who is on them."""

    same: F64  # one person, one scenario
    moved: F64  # one person in two scenarios: another room, light or seed
    different: F64  # two people who dress differently
    alike: F64  # two people dressed alike


def images_of(scenario: str, count: int) -> list[PersonImage]:
    """Return the people that are seen well enough in frames of a scenario."""
    rng = np.random.default_rng(0)
    images = []
    for frame in lab_frames(scenario, count):
        for k, person in enumerate(frame.people):
            visible = person.visible_share >= VISIBLE_MIN
            if visible and inside(person, (frame.rgb.shape[0], frame.rgb.shape[1])).sum() >= 12:
                noise = rng.normal(0, NOISE_PX, (17, 2))
                crops = cut(frame, k, person, noise)
                images.append(PersonImage(frame.bodies[k], scenario, frame.time_s, crops))
    return images


def cut(frame: LabFrame, k: int, person: PersonView, noise: F64) -> tuple[Crop, ...]:
    """Return the crops for each of INPUTS."""
    box: F32 = person.box_xyxy_px.astype(np.float32)
    keypoints = np.ones((17, 3), np.float32)
    keypoints[:, :2] = person.keypoints_px + noise
    mask: U8 = (frame.view.owners == k + 1).astype(np.uint8)
    people = (
        DetectedPerson(1.0, box),
        DetectedPerson(1.0, box, keypoints),
        DetectedPerson(1.0, box, keypoints, InstanceMask(mask, 0, 0)),
    )
    crops = [crop_person(0, person, frame.rgb, 256) for person in people]
    return tuple(crop for crop in crops if crop is not None)


def distances(vectors: F32, images: Sequence[PersonImage]) -> Distances:
    """Return the distances of all pairs of pictures."""
    same, moved, different, alike = [], [], [], []
    for a, b in itertools.combinations(range(len(images)), 2):
        distance = 1 - float(vectors[a] @ vectors[b])
        first, second = images[a], images[b]
        if {first.identity, second.identity} == ALIKE:
            alike.append(distance)
        elif first.identity != second.identity:
            different.append(distance)
        elif first.scenario != second.scenario:
            moved.append(distance)
        elif abs(first.time_s - second.time_s) >= APART_S:
            same.append(distance)
    return Distances(np.array(same), np.array(moved), np.array(different), np.array(alike))


def row(name: str, kind: str, limit: float, pairs: Distances) -> list[str]:
    """Return one line of the table."""
    at_limit = float(np.quantile(pairs.different, FALSE_MATCHES))
    both = np.concatenate([pairs.same, pairs.moved])
    return [
        name,
        kind,
        quantiles(pairs.same, (0.5, 0.95, 0.99)),
        quantiles(pairs.moved, (0.5, 0.95, 0.99)),
        quantiles(pairs.different, (0.0, 0.02, 0.5)),
        quantiles(pairs.alike, (0.0, 0.02, 0.5)),
        f"{at_limit:.2f}",
        f"{np.mean(both <= at_limit):.3f}",
        f"{limit:.2f}: {np.mean(both <= limit):.3f} / {np.mean(pairs.different <= limit):.3f}",
    ]


def quantiles(values: F64, shares: Sequence[float]) -> str:
    """Return quantiles as text."""
    return " / ".join(f"{np.quantile(values, share):.2f}" for share in shares)


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    weights = SHARED / "models" / "osnet_x0_25_msmt17.onnx"
    parser.add_argument("--osnet", type=Path, default=weights, help="OSNet's .onnx file")
    flags = parser.parse_args()
    images = [image for name in SCENARIOS for image in images_of(name, FRAMES)]
    embedders: list[tuple[Embedder, Sequence[int]]] = [
        (load_embedder(ReidConfig(embedder="appearance")), (0, 2)),
        (load_embedder(ReidConfig(embedder="histogram")), (0, 1, 2)),
        (OsnetEmbedder(OnnxSession(flags.osnet)), (0,)),
    ]
    rows = []
    for embedder, kinds in embedders:
        limit = COSINE_DISTANCE_MAX[embedder.name]
        for kind in kinds:
            vectors = embedder.embed([image.crops[kind] for image in images])
            rows.append(row(embedder.name, INPUTS[kind], limit, distances(vectors, images)))
    write(
        __file__,
        "Re-identification: cosine distance of the same and of different people",
        f"{len(images)} pictures of {len({p.identity for p in images})} people of the virtual "
        f"lab in {', '.join(SCENARIOS)}, at least {VISIBLE_MIN:.0%} visible; boxes, keypoints "
        f"({NOISE_PX:.0f} px noise) and masks from truth; pictures of one person in one scenario "
        f"at least {APART_S:.0f} s apart. Alike: {' and '.join(sorted(ALIKE))}, who wear the same.",
        markdown(HEADER, rows),
        "Simulated people in their own clothes are an easier test than a crowd: these figures say "
        "where the limit of a gate belongs. Colour alone cannot tell those apart who dress alike.",
    )


HEADER = [
    "embedder",
    "input",
    "same person, same scenario: p50 / p95 / p99",
    "same person, other scenario: p50 / p95 / p99",
    "different people: min / p2 / p50",
    "dressed alike: min / p2 / p50",
    f"limit at {FALSE_MATCHES:.0%} false matches",
    "true matches there",
    "C_cos: true / false matches",
]


if __name__ == "__main__":
    main()
