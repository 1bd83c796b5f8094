"""What a network finds in each picture, kept: it takes longest, and only pictures change it."""

import hashlib
import os
import time
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from people4d.messages import U8
from services.detector.models.base import DetectedPerson, InstanceMask, PersonModel

CODE = ("services/detector/models/*.py", "common/inference.py", "common/geometry/boxes.py")
PEOPLE_AXES = (17, 3)


@dataclass(frozen=True)
class CachedDetections:
    """The people in one picture.

    Args:
        people: As the model gave them.
        took_ms: What that took.
    """

    people: tuple[DetectedPerson, ...]
    took_ms: float


@dataclass
class DetectionCache:
    """What one model found, by picture.

    Args:
        name: Of the model.
        frames: By `digest` of the picture.
    """

    name: str = ""
    frames: dict[int, CachedDetections] = field(default_factory=dict)


class CachingModel:
    """A model that looks at a picture only if it did not before.

    Args:
        model: What looks.
        known: What it found before; what it finds is added.
    """

    def __init__(self, model: PersonModel, known: DetectionCache) -> None:
        self.name = known.name = model.name
        self.found_new = False
        self._model, self._known = model, known
        self._recalled_ms = 0.0

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        """Find people, see `PersonModel.detect`."""
        key = digest(rgb)
        known = self._known.frames.get(key)
        if known:
            self._recalled_ms += known.took_ms
            return list(known.people)
        start_ns = time.perf_counter_ns()
        people = self._model.detect(rgb)
        took_ms = (time.perf_counter_ns() - start_ns) / 1e6
        self._known.frames[key] = CachedDetections(tuple(people), took_ms)
        self.found_new = True
        return people

    def saved_ms(self) -> float:
        """Return what was saved since the last call by not looking again."""
        saved_ms, self._recalled_ms = self._recalled_ms, 0.0
        return saved_ms


def digest(rgb: U8) -> int:
    """Return what tells a picture from any other."""
    data = np.ascontiguousarray(rgb).data
    return int.from_bytes(hashlib.blake2b(data, digest_size=8).digest())


def save(path: Path, findings: DetectionCache) -> None:
    """Write findings to a file, whole or not at all."""
    people = [person for found in findings.frames.values() for person in found.people]
    masks = [person.mask or InstanceMask(np.zeros((0, 0), np.uint8), 0, 0) for person in people]
    packed = [np.packbits(mask.window) for mask in masks]
    missing = np.full(PEOPLE_AXES, np.nan, np.float32)
    keypoints = [missing if p.keypoints is None else p.keypoints for p in people]
    new = path.with_suffix(f".{os.getpid()}.new")
    path.parent.mkdir(parents=True, exist_ok=True)
    with new.open("wb") as file:
        np.savez_compressed(
            file,
            name=np.array(findings.name),
            digests=np.array(list(findings.frames), np.uint64),
            took_ms=np.array([found.took_ms for found in findings.frames.values()]),
            counts=np.array([len(found.people) for found in findings.frames.values()], np.int64),
            scores=np.array([person.score for person in people]),
            boxes=np.array([person.box_xyxy_px for person in people], np.float32).reshape(-1, 4),
            keypoints=np.array(keypoints, np.float32).reshape(-1, *PEOPLE_AXES),
            windows=np.array([(m.x_px, m.y_px, *m.window.shape) for m in masks], np.int64),
            bits=np.concatenate([np.empty(0, np.uint8), *packed]),
        )
    new.replace(path)


def load(path: Path) -> DetectionCache:
    """Return the findings in a file; none if there is no such file, or it is damaged."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            return _read({name: file[name] for name in file.files})
    except (OSError, EOFError, ValueError, KeyError, IndexError, zipfile.BadZipFile):
        return DetectionCache()


def _read(data: dict[str, np.ndarray]) -> DetectionCache:
    masks, start = [], 0
    for x_px, y_px, height, width in data["windows"].reshape(-1, 4).tolist():
        size = height * width
        end = start + (size + 7) // 8
        window = np.unpackbits(data["bits"][start:end], count=size).reshape(height, width)
        masks.append(InstanceMask(window, x_px, y_px) if size else None)
        start = end
    people = [
        DetectedPerson(score, box, None if np.isnan(points).all() else points, mask)
        for score, box, points, mask in zip(
            data["scores"].tolist(), data["boxes"], data["keypoints"], masks, strict=True
        )
    ]
    found, first = DetectionCache(str(data["name"])), 0
    counts, digests = data["counts"].tolist(), data["digests"].tolist()
    for key, count, took_ms in zip(digests, counts, data["took_ms"].tolist(), strict=True):
        found.frames[key] = CachedDetections(tuple(people[first : first + count]), took_ms)
        first += count
    return found
