"""Falls by neura-fall-detection, a program in its own environment.

    python -m venv .venv-falls && .venv-falls/bin/pip install neura-fall-detection==0.1.0
    .venv-falls/bin/python benchmarks/lib/postures/peer_falls.py SCENES.npz FALLS.npz

An array NAME of the input has the detections of a scene, a row each: time [s], box and 17 keypoints
with confidences, relative to the image; `NAME:s` has the times of all frames. The output has times
of falls by NAME. The package tracks people itself.
"""

import importlib
import sys
from typing import Any

import numpy as np

F64 = np.ndarray[Any, np.dtype[np.float64]]
package: Any = importlib.import_module("neura_fall_detection")
pose: Any = importlib.import_module("neura_fall_detection.pose")


class GivenDetections:
    """Detections in place of the package's own pose network."""

    def __init__(self) -> None:
        self.rows: F64 = np.zeros((0, 56))

    def infer(self, _: F64) -> list[Any]:
        """Return the detections of a frame."""
        return [
            pose.PoseDetection(
                box=row[1:5].astype(np.float32),
                keypoints=row[5:].reshape(17, 3).astype(np.float32),
                score=float(row[7::3].mean()),
            )
            for row in self.rows
        ]


def falls_s(rows: F64, times_s: F64) -> F64:
    """Return the times of the falls of a scene."""
    model, given, found = package.NFDModel(pose_threads=1), GivenDetections(), list[float]()
    model.pose = given
    for time_s in times_s:
        given.rows = rows[rows[:, 0] == time_s]
        found += [time_s] * len(model.process(None, float(time_s)).new_fall_events)
    return np.array(found)


def main() -> None:
    """Detect the falls of all scenes."""
    scenes = dict(np.load(sys.argv[1]))
    names = [name for name in scenes if not name.endswith(":s")]
    found = {name: falls_s(scenes[name], scenes[f"{name}:s"]) for name in names}
    np.savez(sys.argv[2], allow_pickle=False, **found)


if __name__ == "__main__":
    main()
