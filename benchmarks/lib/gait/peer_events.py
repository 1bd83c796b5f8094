"""Landings by the event detectors of gaitkit and myogait, a program in their own environment.

    python -m venv .venv-gait && .venv-gait/bin/pip install gaitkit==1.5.0 myogait==0.9.2
    .venv-gait/bin/python benchmarks/lib/gait/peer_events.py WALKS.npz EVENTS.npz

An array NAME of the input has the samples of a walk:
body, left ankle and right ankle, each ahead along the path, to the left and up [m]; `NAME:hz` is
the rate. The output has `METHOD/NAME`: rows of time since the first sample [s] and side (0: left).
"""

import contextlib
import importlib
import logging
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

F64 = np.ndarray[Any, np.dtype[np.float64]]
Events = list[tuple[float, int]]  # time [s] and side
gaitkit: Any = importlib.import_module("gaitkit")
myogait: Any = importlib.import_module("myogait")
events: Any = importlib.import_module("myogait.events")

ASIDE_M = np.array((0.0, 0.1, 0.0))  # Hip from the body
HIP_ABOVE_M = 0.9  # Height of hips above ankles
SCENE_M = 4.0  # Width and height of the image of normalised coordinates
# Methods that need neither joint angles nor heels and toes
GAITKIT = ("zeni", "ghoussayni", "vancanneyt", "dgei")
MYOGAIT = ("zeni", "velocity", "oconnor")
SIDES = ("left", "right")


def by_gaitkit(method: str, walk: F64, rate_hz: float) -> Events:
    """Return the landings of a walk."""
    frames = [
        {"frame_index": k, "landmark_positions": {n: tuple(1000 * p) for n, p in one.items()}}
        | {f"{side}_{joint}_angle": 0.0 for side in SIDES for joint in ("hip", "knee", "ankle")}
        for k, one in enumerate(landmarks(walk))
    ]
    found = gaitkit.detect(frames, method=method, fps=rate_hz, auto_install_deps=False)
    return [(e["time"], k) for k, one in enumerate((found.left_hs, found.right_hs)) for e in one]


def by_myogait(method: str, walk: F64, rate_hz: float) -> Events:
    """Return the landings of a walk."""
    frames = [
        {
            "frame_idx": k,
            "landmarks": {
                name.upper(): {"x": p[0] / SCENE_M, "y": 1 - p[2] / SCENE_M, "visibility": 1.0}
                for name, p in one.items()
            },
        }
        for k, one in enumerate(landmarks(walk))
    ]
    data = {"frames": frames, "meta": {"fps": rate_hz}}
    found = events.detect_events(data, method=method)["events"]
    return [(e["frame"] / rate_hz, k) for k, s in enumerate(SIDES) for e in found[f"{s}_hs"]]


def landmarks(walk: F64) -> Iterator[dict[str, F64]]:
    """Yield hips and ankles of each sample by name."""
    for body, left, right in walk:
        hip = np.array((body[0], body[1], (left[2] + right[2]) / 2 + HIP_ABOVE_M))
        yield {
            "left_hip": hip + ASIDE_M,
            "right_hip": hip - ASIDE_M,
            "left_ankle": left,
            "right_ankle": right,
        }


def main() -> None:
    """Detect the landings of all walks by all methods."""
    logging.disable(logging.CRITICAL)
    walks, landings = dict(np.load(sys.argv[1])), dict[str, F64]()
    for name in (name for name in walks if not name.endswith(":hz")):
        rate_hz = float(walks[f"{name}:hz"])
        for package, methods, detect in (
            (f"gaitkit {gaitkit.__version__}", GAITKIT, by_gaitkit),
            (f"myogait {myogait.__version__}", MYOGAIT, by_myogait),
        ):
            for method in methods:
                found: Events = []
                with contextlib.suppress(ValueError, IndexError):  # walks that are too short
                    found = detect(method, walks[name], rate_hz)
                landings[f"{package} {method}/{name}"] = np.array(found).reshape(-1, 2)
    np.savez(sys.argv[2], allow_pickle=False, **landings)


if __name__ == "__main__":
    main()
