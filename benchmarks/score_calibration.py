"""Probability that a detection of a score is a person, per people model: fit and reliability.

Detections count as people if they match a mark of a real person (`real_people_marks/`, one to one)
or a simulated person. Fitted to the first half of the real frames and to some seeds of the virtual
lab, tested on the second half, on single images and on other seeds. Models that are not shipped,
and the real images, are looked for in `--shared`.
"""

import argparse
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment, minimize

from benchmarks.lib.lab_frames import LabFrame, lab_frames
from benchmarks.lib.marks.methods import HALF_FRAME, MARKS, ROOT
from benchmarks.lib.marks.recording import read_images
from benchmarks.lib.table import markdown, write
from common.geometry.boxes import iou_xyxy
from common.metrics.record import GroundTruth, Hypotheses
from evaluation.recordings.hand_annotations import crossing_camera
from evaluation.recordings.hand_marks import Mark, read_files, read_frames
from evaluation.recordings.mark_scores import on_marks
from people4d.messages import F64, U8
from services.camera.config import CameraConfig
from services.detector.config import ModelSettings
from services.detector.models.base import DetectedPerson, PersonModel
from services.detector.models.registry import load_model
from services.detector.models.scores import ScoreCalibration

SCENARIOS = ("four_dense", "pmrm1", "three_dense", "short_sit")
FRAMES_PER_SCENARIO = 8
SEEDS = {"fit": 31, "test": 41}
# Least score of each model's detections here: well below that from which they are published
LEAST = {"movenet-multipose": 0.02, "yolov8n-pose": 0.05, "yolov8n-seg": 0.05}
EDGES = (0.02, 0.05, 0.1, 0.15, 0.25, 0.4, 0.6, 1.0)
IOU_MIN = 0.3  # of a detection with the box of a simulated person, ...
INSIDE_MIN = 0.75  # ... or so much of the detection inside the box of one who is partly hidden
VISIBLE_MIN = 0.03  # share of a simulated person that can be found
HEADER = ("model", "frames", "score", "detections", "people", "calibrated score, mean")


@dataclass(frozen=True)
class Scored:
    """Detections of one model in some frames."""

    frames: str  # "real", "single images" or "lab", and half
    scores: F64  # N
    is_person: F64  # N, 1 or 0


def matches_of_marks(people: Sequence[DetectedPerson], marks: Sequence[Mark]) -> F64:
    """Return 1 for each detection on a mark, one to one, else 0."""
    points = [(m.u_px, m.v_px, m.u_px, m.v_px) for m in marks]
    truth = GroundTruth(
        ids=tuple(m.person for m in marks),
        boxes_xyxy_px=np.array(points, np.float64).reshape(-1, 4),
    )
    boxes = np.array([p.box_xyxy_px for p in people], np.float64).reshape(-1, 4)
    found = Hypotheses(ids=tuple(range(len(people))), boxes_xyxy_px=boxes)
    return np.asarray(on_marks(truth, found).sum(axis=0), np.float64)


def matches_of_lab(people: Sequence[DetectedPerson], frame: LabFrame) -> F64:
    """Return 1 for each detection of a simulated person, one to one, else 0."""
    matched = np.zeros(len(people))
    boxes = [p.box_xyxy_px for p in frame.people if p.visible_share > VISIBLE_MIN]
    true = np.array([b for b in boxes if np.isfinite(b).all()], np.float64).reshape(-1, 4)
    if not len(true) or not people:
        return matched
    found = np.array([p.box_xyxy_px for p in people], np.float64)
    overlap = iou_xyxy(found, true)
    areas = (true[:, 2:] - true[:, :2]).prod(axis=1)
    own = (found[:, 2:] - found[:, :2]).prod(axis=1)
    shared = overlap / (1 + overlap) * (own[:, None] + areas)
    overlap[(overlap < IOU_MIN) & (shared < INSIDE_MIN * own[:, None])] = 0.0
    rows, columns = linear_sum_assignment(-overlap)
    matched[rows] = overlap[rows, columns] > 0
    return matched


def real_frames(shared: Path) -> Iterator[tuple[str, U8, Sequence[Mark]]]:
    """Yield a name, the image and the marks of each real frame."""
    _, images = read_images(crossing_camera(shared))
    for number, marks in read_frames(MARKS / "filinha.json").items():
        half = "first" if number < HALF_FRAME else "second"
        yield f"real, {half} half", images[number].rgb, marks
    for file, marks in read_files(MARKS / "tue.json").items():
        source = shared / "data" / "rgbd" / "tue" / file
        if source.suffix == ".bag":
            _, images = read_images(CameraConfig(source=str(source), playback="lockstep", window=1))
            yield "real, single images", images[0].rgb, marks


def score(
    model: PersonModel,
    real: Sequence[tuple[str, U8, Sequence[Mark]]],
    lab: Sequence[tuple[str, LabFrame]],
) -> list[Scored]:
    """Run a model over all frames."""
    scores, persons = dict[str, list[float]](), dict[str, list[float]]()

    def add(name: str, people: Sequence[DetectedPerson], matched: F64) -> None:
        scores.setdefault(name, []).extend(p.score for p in people)
        persons.setdefault(name, []).extend(matched.tolist())

    for name, rgb, marks in real:
        people = model.detect(rgb)
        add(name, people, matches_of_marks(people, marks))
    for name, frame in lab:
        people = model.detect(frame.rgb)
        add(name, people, matches_of_lab(people, frame))
    return [Scored(name, np.array(scores[name]), np.array(persons[name])) for name in scores]


def fit(parts: Sequence[Scored]) -> ScoreCalibration:
    """Return the calibration of largest likelihood."""
    scores = np.concatenate([part.scores for part in parts])
    people = np.concatenate([part.is_person for part in parts])

    def cost(x: F64) -> float:
        p = np.clip(
            ScoreCalibration(math.exp(x[0]), math.exp(x[1])).probability(scores), 1e-6, 1 - 1e-6
        )
        return float(-(people * np.log(p) + (1 - people) * np.log(1 - p)).sum())

    best = minimize(cost, [math.log(0.1), math.log(2.0)], method="Nelder-Mead").x
    return ScoreCalibration(round(math.exp(best[0]), 3), round(math.exp(best[1]), 1))


def rows(name: str, part: Scored, calibration: ScoreCalibration) -> Iterator[list[str]]:
    """Yield the reliability of scores in steps."""
    for low, high in itertools.pairwise(EDGES):
        inside = (part.scores >= low) & (part.scores < high)
        if inside.any():
            mean = calibration.probability(part.scores[inside]).mean()
            share = (
                f"{part.is_person[inside].sum():.0f} ({100 * part.is_person[inside].mean():.0f} %)"
            )
            yield [
                name,
                part.frames,
                f"{low:.2f} to {high:.2f}",
                str(inside.sum()),
                share,
                f"{mean:.2f}",
            ]


def main() -> None:
    """Fit each model that is there, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    shared = parser.parse_args().shared
    cv2.setNumThreads(1)
    real = list(real_frames(shared))
    lab = [
        (f"lab, {part}", frame)
        for part, seed in SEEDS.items()
        for scenario in SCENARIOS
        for frame in lab_frames(scenario, FRAMES_PER_SCENARIO, seed)
    ]
    fitted, table = [], []
    for name, least in LEAST.items():
        path = (
            name
            if name == "movenet-multipose"
            else str(shared / "data" / "models" / f"{name}_640.onnx")
        )
        if path.endswith(".onnx") and not Path(path).exists():
            continue
        model = load_model(ModelSettings(model=path, score_min=least, scores="network"))
        parts = score(model, real, lab)
        calibration = fit([p for p in parts if p.frames in ("real, first half", "lab, fit")])
        fitted.append([name, str(calibration.midpoint), str(calibration.slope)])
        print(*fitted[-1], flush=True)
        table += [row for part in parts for row in rows(name, part, calibration)]
    write(
        __file__,
        "Calibration of scores",
        "The probability that a detection of score s is a person is 1 / (1 + (m / s)^k). m and k "
        "are fitted to the first half of the real frames (filinha) and to seed "
        f"{SEEDS['fit']} of the lab ({', '.join(SCENARIOS)}); the other rows test them.",
        markdown(("model", "midpoint m", "slope k"), fitted),
        "## Reliability",
        markdown(HEADER, table),
    )


if __name__ == "__main__":
    main()
