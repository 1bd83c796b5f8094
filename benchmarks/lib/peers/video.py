"""Tracking in images by other packages, a program in their own environment.

    python -m venv .venv-video && .venv-video/bin/pip install torch==2.13.0 ultralytics==8.4.190 \
        lap==0.5.12 onnxruntime trackers==2.6.1
    .venv-video/bin/pip install --no-deps norfair==2.3.0 filterpy  # it asks for an older rich
    .venv-video/bin/python -P benchmarks/lib/peers/video.py FRAMES.npy MODEL.onnx TIMES.json

It needs nothing of this project; `benchmarks.peers` calls it. Input: frames (NxHxWx3, RGB, bytes)
and a network of the layout of YOLOv8-pose, 1x56xK for an input of 640x640. All run in one thread.
Output: for each peer its version and the seconds of each frame, from the image to tracks.
Ultralytics tracks with ByteTrack as it ships; the others get boxes from onnxruntime, after
suppression of overlapping ones by OpenCV.
"""

import importlib
import importlib.metadata
import importlib.util
import json
import os
import sys
import time
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["YOLO_VERBOSE"] = "False"

import cv2
import numpy as np
import onnxruntime

SIDE = 640  # [px] of the input
SCORE_MIN, IOU_MAX = 0.25, 0.7  # thresholds of Ultralytics
WARM_UP = 10
RATE_HZ = 15.0
Image = np.ndarray[Any, np.dtype[np.uint8]]
Track = Callable[[Image], int]  # counter of tracks in a BGR image


def one_thread() -> None:
    """Limit all libraries to one thread, including sessions of onnxruntime in other packages."""
    cv2.setNumThreads(1)
    session = onnxruntime.InferenceSession

    def limited(path: Any, sess_options: Any = None, **options: Any) -> Any:
        sess_options = sess_options or onnxruntime.SessionOptions()
        sess_options.intra_op_num_threads = sess_options.inter_op_num_threads = 1
        return session(path, sess_options, **options)

    onnxruntime.InferenceSession = limited


def ultralytics(model: str) -> Track:
    """Ultralytics' own tracking of people: `model.track`.

    If torchvision does not fit torch, Ultralytics' own suppression of overlapping boxes replaces
    it.
    """
    torch: Any = importlib.import_module("torch")
    torch.set_num_threads(1)
    try:
        importlib.import_module("torchvision")
    except (ImportError, RuntimeError):
        stand_in: Any = types.ModuleType("torchvision")
        own = importlib.import_module("ultralytics.utils.nms").TorchNMS
        stand_in.ops = types.SimpleNamespace(nms=own.nms)
        sys.modules["torchvision"] = stand_in
    yolo = importlib.import_module("ultralytics").YOLO(model, task="pose")

    def track(image: Image) -> int:
        (result,) = yolo.track(
            image, persist=True, tracker="bytetrack.yaml", device="cpu", verbose=False
        )
        return len(result.boxes)

    return track


def behind_onnxruntime(name: str) -> Callable[[str], Track]:
    """A tracker of peers/mot.py on boxes of the network."""

    def opened(model: str) -> Track:
        path = Path(__file__).with_name("mot.py")
        spec = importlib.util.spec_from_file_location("mot", path)
        assert spec
        assert spec.loader
        mot = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(mot)
        _, make, settings = mot.PEERS[name]
        update = make(RATE_HZ, **settings[0])
        session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])

        def track(image: Image) -> int:
            identities, _ = update(*detect(session, image))
            return len(identities)

        return track

    return opened


def detect(session: Any, image: Image) -> tuple[Any, Any]:
    """Return the boxes (Nx4 xyxy) and scores of people."""
    height, width = image.shape[:2]
    scale = SIDE / max(height, width)
    padded = np.full((SIDE, SIDE, 3), 114, np.uint8)
    small = cv2.resize(image, (round(width * scale), round(height * scale)))
    padded[: small.shape[0], : small.shape[1]] = small
    blob = cv2.dnn.blobFromImage(padded, 1 / 255, swapRB=True)
    (output,) = session.run(None, {session.get_inputs()[0].name: blob})
    rows = output[0].T
    rows = rows[rows[:, 4] > SCORE_MIN]
    corners = np.column_stack([rows[:, :2] - rows[:, 2:4] / 2, rows[:, 2:4]])
    best = cv2.dnn.NMSBoxes(corners.tolist(), rows[:, 4].tolist(), SCORE_MIN, IOU_MAX)
    chosen = np.asarray(best, int).ravel()
    boxes = corners[chosen].astype(np.float64) / scale
    boxes[:, 2:] += boxes[:, :2]
    return boxes, rows[chosen, 4].astype(np.float64)


PEERS: dict[str, tuple[str, Callable[[str], Track]]] = {
    "Ultralytics' track": ("ultralytics", ultralytics),
    "onnxruntime and ByteTrack of trackers": ("trackers", behind_onnxruntime("trackers ByteTrack")),
    "onnxruntime and norfair": ("norfair", behind_onnxruntime("norfair")),
}


def main() -> None:
    """Time all peers that are installed."""
    frames, model, target = sys.argv[1:]
    images = [cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR) for rgb in np.load(frames)]
    one_thread()
    found = {}
    for name, (package, opened) in PEERS.items():
        try:
            version = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
        track = opened(model)
        times_s, tracks = [], 0
        for number, image in enumerate(images):
            begin_s = time.perf_counter()
            tracks += track(image)
            if number >= WARM_UP:
                times_s.append(time.perf_counter() - begin_s)
        found[name] = {"version": version, "times_s": times_s, "tracks": tracks}
    Path(target).write_text(json.dumps(found), encoding="utf-8")


if __name__ == "__main__":
    main()
