"""Positions of people by each method of the detector, against the truth of the virtual lab.

Frames are drawn as a camera would take them, depth with the errors of its sensor. Each frame counts
by itself, without a tracker. Models that are not shipped are looked for in `--shared`.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.lib.table import markdown, write
from benchmarks.real_inputs import ROOT, models
from evaluation.recordings.rendered import HELD_OUT, RenderedFrame, matches, render
from people4d.messages import F64, U8, Detection, Detections
from services.detector.build import build
from services.detector.config import DetectorConfig
from services.detector.models.base import DetectedPerson, PersonModel
from services.detector.models.registry import load_model

SEPARATE = {"method": "separate", "weighted": False}  # orientation, by which to_axis works
METHODS = {
    "movenet-multipose": ("keypoints", "grown", "torso"),
    "yolov8n-pose": ("keypoints", "grown", "torso"),
    "yolov8n-seg": ("mask", "torso"),
}
HEADER = [
    *("model", "position", "to axis", "found", "across: bias m", "RMSE m"),
    *("along: bias m", "RMSE m", "median m", "NES"),
]


@dataclass
class Errors:
    """Errors of detections against the truth."""

    rows: list[F64] = field(default_factory=list)  # to the right, downward, along; metres
    squared: list[float] = field(default_factory=list)  # normalised by the covariance


class CachedModel:
    """Gives what a model found before, since every method asks for the same frames.

    Args:
        model: Is asked once for each frame.
    """

    def __init__(self, model: PersonModel) -> None:
        self.name = model.name
        self._model = model
        self._found: dict[int, list[DetectedPerson]] = {}

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        """Find people; pictures are told apart by where they are in memory."""
        key = rgb.ctypes.data
        if key not in self._found:
            self._found[key] = self._model.detect(rgb)
        return self._found[key]


def measure(model: PersonModel, config: DetectorConfig, taken: Sequence[RenderedFrame]) -> Errors:
    """Return the errors of one method over all frames."""
    node, errors = build(config, model), Errors()
    for rendered in taken:
        node.handle(rendered.info, 0)
        output = node.handle(rendered.frame, 0)[-1]
        assert isinstance(output, Detections)
        for index, detection in matches(rendered.people, output.detections).items():
            add(errors, rendered.positions_m[index], detection)
    return errors


def add(errors: Errors, position_true_m: F64, detection: Detection) -> None:
    """Add the error of a detection that has a position."""
    if detection.position_m is None or detection.position_covariance_m2 is None:
        return
    gap_m = detection.position_m - position_true_m
    ray = position_true_m / np.linalg.norm(position_true_m)
    right = np.array([ray[2], 0.0, -ray[0]]) / np.hypot(ray[0], ray[2])
    errors.rows.append(np.stack([right, np.cross(ray, right), ray]) @ gap_m)
    errors.squared.append(float(gap_m @ np.linalg.solve(detection.position_covariance_m2, gap_m)))


def row(name: str, position: str, to_axis: bool, errors: Errors, people: int) -> list[str]:
    """Return the cells of one method."""
    right, _, along = np.array(errors.rows).T
    cells = [name, position, "yes" if to_axis else "no", f"{len(right) / people:.0%}"]
    cells += [f"{right.mean():+.3f}", f"{np.sqrt(np.mean(right**2)):.3f}"]
    cells += [f"{along.mean():+.3f}", f"{np.sqrt(np.mean(along**2)):.3f}"]
    return [*cells, f"{np.median(np.abs(along)):.3f}", f"{np.mean(errors.squared):.1f}"]


def main() -> None:
    """Measure every model that is there, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    shared = parser.parse_args().shared
    taken = list(render(HELD_OUT))
    people = sum(len(rendered.people) for rendered in taken)
    rows = []
    for name, path in models(shared).items():
        if path.endswith(".onnx") and not Path(path).exists():
            continue
        model = CachedModel(load_model(DetectorConfig(model=path)))
        for position in METHODS[name]:
            for to_axis in (False, True):
                settings = {"position": position, "to_axis": to_axis, "orientation": SEPARATE}
                config = msgspec.convert(settings | {"crops": False}, DetectorConfig)
                found = measure(model, config, taken)
                rows.append(row(name, position, to_axis, found, people))
    text = (
        f"{people} views of people of whom at least 35 % is seen, in {len(taken)} frames of "
        + ", ".join(f"{name} (seed {seed})" for name, seed, _ in HELD_OUT)
        + ". Errors of single frames, across and along the line of sight, from the mean of "
        "shoulders and hips. Along: negative is too near. NES is the mean of the squared error "
        "normalised by the covariance that the detection tells: 3 if that is right, less if it is "
        "careful. A few large errors are people of whom the model made one with somebody in front."
    )
    write(__file__, "Positions of people", text, markdown(HEADER, rows))


if __name__ == "__main__":
    main()
