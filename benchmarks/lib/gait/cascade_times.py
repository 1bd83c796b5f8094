"""Frames a second of the cascade and its colour layer on stored frames, as a script.

PYTHONPATH chooses the checkout that is measured. Prints the rates as JSON, by name.
"""

import json
import pickle
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from services.gait.cascade import Cascade, PersonObservation
from services.gait.colour.colour_layer import ColourLayer
from services.gait.config import CascadeConfig, ColourLayerConfig

BOX = np.array((245.0, 115.0, 395.0, 365.0))  # Box of the colour layer, 150x250 [px]
PARTICLES = 100  # Number of particles of the colour layer


def cascade_seconds(info: Any, frames: list[Any]) -> float:
    """Return the processor's time of the cascade for all frames."""
    cascade, spent_s = Cascade(CascadeConfig(), info), 0.0
    for stamp_ns, rgb, depth_mm, people, pose in frames:
        observations = [PersonObservation(*one) for one in people]
        begin_s = time.process_time()
        cascade.update_people(stamp_ns, rgb, depth_mm, observations, pose)
        spent_s += time.process_time() - begin_s
    return spent_s


def colour_seconds(frames: list[Any]) -> float:
    """Return the processor's time of the colour layer for all frames."""
    layer = ColourLayer(ColourLayerConfig(particles=PARTICLES))
    layer.start_person(1, frames[0][1], BOX)
    begin_s = time.process_time()
    for _, rgb, *_ in frames:
        layer.update_boxes(rgb)
    return time.process_time() - begin_s


def main() -> None:
    """Measure each recording after one pass that compiles the kernels."""
    found = {}
    for name, (info, frames) in pickle.loads(Path(sys.argv[1]).read_bytes()).items():
        for _ in range(2):
            found[name] = len(frames) / cascade_seconds(info, frames)
            found["colour layer"] = len(frames) / colour_seconds(frames)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
