"""Trackers of other packages on stored detections, a program in their own environment.

    python -m uv venv .venv-peers
    python -m uv pip install --python .venv-peers norfair==2.3.0 motrackers==0.1.1 trackers==2.6.1 \
        ioutrack-rs==0.4.0 --override benchmarks/peers-override.txt
    python -m venv .venv-boxmot && .venv-boxmot/bin/pip install boxmot==25.0.0 torch==2.13.0
    .venv-peers/bin/python benchmarks/lib/peers/mot.py DETECTIONS.npz TRACKS.npz CHOSEN

It needs nothing of this project; `benchmarks.scoreboard` calls it.
Input: for each sequence NAME an array NAME (frame, left, top, right, bottom, score) and NAME:info
(frames, rate in Hz). CHOSEN is JSON: settings by the name of the tracker, {} for all. Output: for
each tracker T, setting K and sequence NAME an array T/K/NAME (frame, identity, left, top, right,
bottom), T/K/NAME:us (microseconds of each frame), and T/K:words.
"""

import importlib
import importlib.metadata
import json
import logging
import sys
import time
import warnings
from collections import ChainMap
from collections.abc import Callable
from itertools import pairwise, product
from typing import Any

import numpy as np

Rows = np.ndarray[Any, np.dtype[np.float64]]
Update = Callable[[Rows, Rows], tuple[Any, Rows]]
Options = dict[str, Any]


def norfair(_rate_hz: float, gate: float, matched_only: bool, **options: Any) -> Update:
    """Norfair with the overlap of boxes as distance; `matched_only` as in `motrackers`."""
    package = importlib.import_module("norfair")
    tracker = package.Tracker(distance_function="iou", **options)

    def update(boxes: Rows, scores: Rows) -> tuple[Any, Rows]:
        found = [
            package.Detection(points=box.reshape(2, 2), scores=np.array([score, score]))
            for box, score in zip(boxes, scores, strict=True)
            if score >= gate
        ]
        tracks = tracker.update(found)
        if matched_only:
            tracks = [one for one in tracks if any(one.last_detection is d for d in found)]
        corners = np.array([one.estimate.ravel() for one in tracks]).reshape(-1, 4)
        return [one.id for one in tracks], corners

    return update


def motrackers(_rate_hz: float, gate: float, matched_only: bool, max_lost: int) -> Update:
    """SORT of motrackers; `matched_only` leaves out tracks that were not matched."""
    tracker = importlib.import_module("motrackers").SORT(max_lost=max_lost)

    def update(boxes: Rows, scores: Rows) -> tuple[Any, Rows]:
        accepted = scores >= gate
        corners = np.column_stack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]])[accepted]
        tracks = tracker.update(corners, scores[accepted], np.zeros(len(corners), int))
        if matched_only:
            tracks = [one for one in tracks if tracker.tracks[one[1]].lost == 0]
        rows = np.array([[t[1], t[2], t[3], t[2] + t[4], t[3] + t[5]] for t in tracks])
        rows = rows.reshape(-1, 5)
        return rows[:, 0], rows[:, 1:]

    return update


def roboflow(rate_hz: float, kind: str, gate: float, **options: Any) -> Update:
    """One of trackers."""
    detections = importlib.import_module("supervision").Detections
    tracker = getattr(importlib.import_module("trackers"), kind)(frame_rate=rate_hz, **options)

    def update(boxes: Rows, scores: Rows) -> tuple[Any, Rows]:
        accepted = scores >= gate
        classes = np.zeros(int(accepted.sum()), int)
        tracks = tracker.update(
            detections(xyxy=boxes[accepted], confidence=scores[accepted], class_id=classes)
        )
        if tracks.tracker_id is None:
            return [], np.zeros((0, 4))
        known = tracks.tracker_id >= 0
        return tracks.tracker_id[known], tracks.xyxy[known]

    return update


def ioutrack(_rate_hz: float, kind: str, gate: float, **options: Any) -> Update:
    """Tracker of ioutrack-rs, which is written in Rust."""
    tracker = getattr(importlib.import_module("ioutrack"), kind)(**options)

    def update(boxes: Rows, scores: Rows) -> tuple[Any, Rows]:
        accepted = scores >= gate
        tracks = tracker.update(np.column_stack([boxes, scores])[accepted], False)
        return tracks[:, 4], tracks[:, :4].astype(np.float64)

    return update


def boxmot(_rate_hz: float, kind: str, gate: float, **options: Any) -> Update:
    """Tracker of BoxMOT, without its networks for appearance."""
    tracker = getattr(importlib.import_module("boxmot"), kind)(**options)
    blank = np.zeros((480, 640, 3), np.uint8)

    def update(boxes: Rows, scores: Rows) -> tuple[Any, Rows]:
        accepted = scores >= gate
        rows = np.column_stack([boxes, scores, np.zeros(len(scores))])[accepted]
        tracks = np.asarray(tracker.update(rows, blank)).reshape(-1, 8)
        return tracks[:, 4], tracks[:, :4]

    return update


Peer = tuple[str, Callable[..., Update], list[Options]]  # package, function, settings


def peer(package: str, make: Callable[..., Update], *parts: dict[str, list[Any]]) -> Peer:
    """Return a peer with all combinations of settings, its own ones first."""
    choices = dict(ChainMap(*reversed(parts)))
    settings = [dict(zip(choices, values, strict=True)) for values in product(*choices.values())]
    return package, make, settings


BUFFERS: dict[str, list[Any]] = {"gate": [0.0], "lost_track_buffer": [30, 5]}
ACTIVATION = [0.7, 0.9]
PEERS: dict[str, Peer] = {
    "norfair": peer(
        "norfair",
        norfair,
        {"matched_only": [False, True], "gate": [0.0, 0.8]},
        {"distance_threshold": [0.7], "hit_counter_max": [15, 5]},
    ),
    "motrackers SORT": peer(
        "motrackers",
        motrackers,
        {"matched_only": [False, True], "gate": [0.0, 0.8], "max_lost": [0, 1, 5]},
    ),
    "trackers SORT": peer(
        "trackers",
        roboflow,
        {"kind": ["SORTTracker"], "minimum_consecutive_frames": [3, 1]},
        {"track_activation_threshold": [0.25, 0.9]},
        BUFFERS,
    ),
    "trackers ByteTrack": peer(
        "trackers",
        roboflow,
        {"kind": ["ByteTrackTracker"], "minimum_consecutive_frames": [2, 1]},
        BUFFERS,
        {"track_activation_threshold": ACTIVATION, "high_conf_det_threshold": [0.6, 0.8]},
    ),
    "trackers OC-SORT": peer(
        "trackers",
        roboflow,
        {"kind": ["OCSORTTracker"], "minimum_consecutive_frames": [3, 1]},
        BUFFERS,
        {"high_conf_det_threshold": [0.6, 0.8, 0.9]},
    ),
    "trackers C-BIoU": peer(
        "trackers",
        roboflow,
        {"kind": ["CBIoUTracker"], "minimum_consecutive_frames": [2, 1]},
        BUFFERS,
        {"track_activation_threshold": ACTIVATION, "high_conf_det_threshold": [0.6, 0.8]},
    ),
    "ioutrack-rs SORT": peer(
        "ioutrack-rs",
        ioutrack,
        {"kind": ["Sort"], "gate": [0.0], "min_hits": [3, 1], "max_age": [1, 5]},
        {"init_tracker_min_score": [0.0, 0.9]},
    ),
    "ioutrack-rs ByteTrack": peer(
        "ioutrack-rs",
        ioutrack,
        {"kind": ["ByteTrack"], "gate": [0.0], "min_hits": [3, 1], "max_age": [1, 5, 15]},
        {"init_tracker_min_score": [0.8, 0.9], "high_score_threshold": [0.7]},
    ),
    "BoxMOT ByteTrack": peer(
        "boxmot",
        boxmot,
        {"kind": ["ByteTrack"], "gate": [0.0], "track_thresh": [0.45, 0.6]},
        {"match_thresh": [0.8, 0.9], "track_buffer": [25, 60]},
    ),
    "BoxMOT OC-SORT": peer(
        "boxmot",
        boxmot,
        {"kind": ["OcSort"], "gate": [0.0], "min_hits": [3, 1], "max_age": [30, 60]},
        {"use_byte": [False, True]},
    ),
    "BoxMOT SFSORT": peer(
        "boxmot",
        boxmot,
        {"kind": ["SFSORT"], "gate": [0.0], "central_timeout": [0, 30]},
        {"marginal_timeout": [0, 10], "high_th": [0.6, 0.5]},
    ),
    "BoxMOT BoT-SORT": peer(
        "boxmot",
        boxmot,
        {"kind": ["BotSort"], "gate": [0.0], "use_embeddings": [False], "use_cmc": [False]},
        {"track_buffer": [30, 60], "new_track_thresh": [0.6, 0.5]},
    ),
}


def run(update: Update, rows: Rows, frames: int) -> tuple[Rows, Rows]:
    """Return tracks (frame, identity, corners), and the microseconds of each frame."""
    edges = np.searchsorted(rows[:, 0], np.arange(1, frames + 2))
    tracks, times_us = [np.zeros((0, 6))], []
    for number, (start, end) in enumerate(pairwise(edges), 1):
        boxes, scores = rows[start:end, 1:5].copy(), rows[start:end, 5].copy()
        began_ns = time.perf_counter_ns()
        ids, corners = update(boxes, scores)
        times_us.append((time.perf_counter_ns() - began_ns) / 1e3)
        tracks.append(np.column_stack([np.full(len(ids), number), ids, corners]))
    return np.vstack(tracks), np.array(times_us)


def words(options: Options) -> str:
    """Return settings as text."""
    return ", ".join(f"{name} {value}" for name, value in options.items() if name != "kind")


def measure(name: str, given: dict[str, Rows], chosen: list[int]) -> dict[str, Any]:
    """Run one tracker with some of its settings, or all."""
    package, make, settings = PEERS[name]
    results: dict[str, Any] = {f"{name}:version": importlib.metadata.version(package)}
    sequences = [key for key in given if not key.endswith(":info")]
    for number in chosen or range(len(settings)):
        results[f"{name}/{number}:words"] = words(settings[number])
        for sequence in sequences:
            frames, rate_hz = given[f"{sequence}:info"]
            tracks, times_us = run(make(rate_hz, **settings[number]), given[sequence], int(frames))
            results[f"{name}/{number}/{sequence}"] = tracks
            results[f"{name}/{number}/{sequence}:us"] = times_us
    return results


def main() -> None:
    """Run all trackers that are installed."""
    warnings.simplefilter("ignore")
    logging.disable(logging.WARNING)
    source, target, chosen = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
    with np.load(source) as file:
        given = dict(file)
    results: dict[str, Any] = {}
    for name in chosen or PEERS:
        try:
            results |= measure(name, given, chosen.get(name, []))
        except ImportError as error:
            print(f"{name} is left out: {error}", file=sys.stderr)
    np.savez(target, **results)


if __name__ == "__main__":
    main()
