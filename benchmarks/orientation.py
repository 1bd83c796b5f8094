"""Yaw of people by each part of the method, against the truth of the virtual lab.

Frames are drawn as a camera would take them, depth with the errors of its sensor. Each frame counts
by itself, without a tracker.
"""

import argparse
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from benchmarks.lib.table import markdown, write
from benchmarks.positions import CachedModel
from evaluation.recordings.rendered import RenderedFrame, matches, render, yaw_error_deg
from people4d.messages import F64, Detections
from services.detector.build import build
from services.detector.config import DetectorConfig
from services.detector.models.registry import load_model

# Scenario, seed and frames, none of which were used to choose a constant of the method.
SEQUENCES = (
    ("four_crossing", 80, range(60, 460, 8)),
    ("four_dense", 81, range(60, 460, 8)),
    ("pmrm1", 82, range(30, 430, 14)),
)
QUICK = (("four_crossing", 80, range(60, 460, 40)),)
GROSS_DEG = 45
SEPARATE = {"method": "separate", "weighted": False}
KEYPOINTS = {"method": "joint", "network": {"model": ""}}
METHODS: dict[str, dict[str, Any]] = {
    "shoulders in 3D": SEPARATE | {"ratio": False},
    "proportions": SEPARATE | {"vector": False},
    "both (paper)": SEPARATE,
    "both, weighted": SEPARATE | {"weighted": True},
    "joint likelihood": {"method": "joint"},
    "without the network": KEYPOINTS,
    "and without depth": KEYPOINTS | {"body": {"use_depth": False}},
    "and without hips": KEYPOINTS | {"body": {"use_hips": False}},
    "and without head": KEYPOINTS | {"body": {"use_head": False}},
    "and with confidence": KEYPOINTS | {"body": {"use_confidence": True}},
}
HEADER = [
    "method",
    "told",
    "bias deg",
    "median deg",
    "RMSE deg",
    "RMSE of the rest",
    f"> {GROSS_DEG} deg",
]


def errors_deg(config: DetectorConfig, model: CachedModel, taken: Sequence[RenderedFrame]) -> F64:
    """Return the errors of all people found, NaN where no angle is told."""
    node, errors = build(config, model), list[float]()
    for rendered in taken:
        node.handle(rendered.info, 0)
        output = node.handle(rendered.frame, 0)[-1]
        assert isinstance(output, Detections)
        for index, detection in matches(rendered.people, output.detections).items():
            errors.append(yaw_error_deg(rendered, index, detection))
    return np.array(errors)


def row(name: str, errors: F64) -> list[str]:
    """Return the cells of one method."""
    known = errors[np.isfinite(errors)]
    size = np.abs(known)
    rest = known[size <= GROSS_DEG]
    cells = [name, f"{len(known) / len(errors):.0%}", f"{np.median(known):+.1f}"]
    cells += [f"{np.median(size):.1f}", f"{np.sqrt(np.mean(known**2)):.1f}"]
    return [*cells, f"{np.sqrt(np.mean(rest**2)):.1f}", f"{np.mean(size > GROSS_DEG):.1%}"]


def main() -> None:
    """Measure every method, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few frames, nothing is written")
    quick = parser.parse_args().quick
    sequences = QUICK if quick else SEQUENCES
    taken = list(render(sequences))
    model = CachedModel(load_model(DetectorConfig()))
    rows, count = [], 0
    for name, output in METHODS.items():
        settings = {"position": "torso", "crops": False, "orientation": output}
        found = errors_deg(msgspec.convert(settings, DetectorConfig), model, taken)
        count = len(found)
        rows.append(row(name, found))
    text = (
        f"{count} people found by MoveNet, of each at least 35 % seen, in {len(taken)} frames of "
        + ", ".join(f"{name} (seed {seed})" for name, seed, _ in sequences)
        + ". Single frames, without the tracker's filter. The rest is all but errors above "
        f"{GROSS_DEG} deg, most of which are people who are half hidden, or whose left and right "
        "are taken for each other."
    )
    if quick:
        print(markdown(HEADER, rows))
    else:
        write(__file__, "The way people face", text, markdown(HEADER, rows))


if __name__ == "__main__":
    main()
