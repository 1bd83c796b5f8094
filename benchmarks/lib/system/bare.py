"""The reference of all speeds: a network alone, in one thread, in the same round."""

import time
from pathlib import Path

import numpy as np

from common.inference.engines import open_session
from common.io.weights import choose, find, folders, load_manifest
from services.detector.config import ModelSettings
from services.detector.models.network import ImageInput

FLOAT = "movenet-multipose"  # Float network, the unit of times
INFERENCE = ("inference", "inference_wait")  # Stages of the networks
MEASURED_S = 2.0
SIZE_PX = (256, 320)  # Input of a network with any size: height, width


def bare_ms(model: str = FLOAT) -> float:
    """Return the mean time of one run with a detector's settings [ms]."""
    path = Path(model)
    if path.suffix != ".onnx":
        path = find(choose(model, load_manifest()), folders(""))
    session = open_session(path)
    image = ImageInput.from_session(session, ModelSettings(), SIZE_PX)
    tensor = image.tensor(np.full((image.height, image.width, 3), 114, np.uint8), 1.0)
    session.run(tensor)
    runs, start_s = 0, time.perf_counter()
    while time.perf_counter() - start_s < MEASURED_S:
        session.run(tensor)
        runs += 1
    return 1e3 * (time.perf_counter() - start_s) / runs
