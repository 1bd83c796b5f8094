"""Cache of a network's detections in each image: the slowest step, and only images change it."""

import hashlib
import os
import time
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import services.detector.models
from common import inference
from common.geometry import boxes
from people4d.messages import U8
from services.detector.models.base import DetectedPerson, InstanceMask, PersonModel

CODE = (services.detector.models, inference, boxes)
KEYPOINTS = (17, 3)


@dataclass(frozen=True)
class CachedDetections:
    """The people in one image."""

    people: tuple[DetectedPerson, ...]  # output of the model
    took_ms: float  # time of the inference


@dataclass
class DetectionCache:
    """Detections of one model by image."""

    name: str = ""  # name of the model
    frames: dict[int, CachedDetections] = field(default_factory=dict)  # by `digest` of the image


class CachingModel:
    """A model that runs only on images that are not in a cache; new detections are added to it."""

    def __init__(self, model: PersonModel, cache: DetectionCache) -> None:
        self.name = cache.name = model.name
        self.changed = False  # True: there are new detections in the cache
        self._model, self._cache = model, cache
        self._saved_ms = 0.0

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        """Find people, see `PersonModel.detect`."""
        key = digest(rgb)
        cached = self._cache.frames.get(key)
        if cached:
            self._saved_ms += cached.took_ms
            return list(cached.people)
        start_ns = time.perf_counter_ns()
        people = self._model.detect(rgb)
        took_ms = (time.perf_counter_ns() - start_ns) / 1e6
        self._cache.frames[key] = CachedDetections(tuple(people), took_ms)
        self.changed = True
        return people

    def saved_ms(self) -> float:
        """Return the time that the cache saved since the last call."""
        saved_ms, self._saved_ms = self._saved_ms, 0.0
        return saved_ms


def digest(rgb: U8) -> int:
    """Return a digest of an image."""
    data = np.ascontiguousarray(rgb).data
    return int.from_bytes(hashlib.blake2b(data, digest_size=8).digest())


def save(path: Path, cache: DetectionCache) -> None:
    """Write a cache to a file, complete or not at all."""
    frames = cache.frames.values()
    people = [person for frame in frames for person in frame.people]
    masks = [person.mask or InstanceMask(np.zeros((0, 0), np.uint8), 0, 0) for person in people]
    packed = [np.packbits(mask.window) for mask in masks]
    missing = np.full(KEYPOINTS, np.nan, np.float32)
    keypoints = [missing if p.keypoints is None else p.keypoints for p in people]
    new = path.with_suffix(f".{os.getpid()}.new")
    path.parent.mkdir(parents=True, exist_ok=True)
    with new.open("wb") as file:
        np.savez_compressed(
            file,
            name=np.array(cache.name),
            digests=np.array(list(cache.frames), np.uint64),
            took_ms=np.array([frame.took_ms for frame in frames]),
            counts=np.array([len(frame.people) for frame in frames], np.int64),
            scores=np.array([person.score for person in people]),
            boxes=np.array([person.box_xyxy_px for person in people], np.float32).reshape(-1, 4),
            keypoints=np.array(keypoints, np.float32).reshape(-1, *KEYPOINTS),
            windows=np.array([(m.x_px, m.y_px, *m.window.shape) for m in masks], np.int64),
            bits=np.concatenate([np.empty(0, np.uint8), *packed]),
        )
    new.replace(path)


def load(path: Path) -> DetectionCache:
    """Return the cache in a file; an empty one if there is no such file, or it is damaged."""
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
    cache, first = DetectionCache(str(data["name"])), 0
    counts, digests = data["counts"].tolist(), data["digests"].tolist()
    for key, count, took_ms in zip(digests, counts, data["took_ms"].tolist(), strict=True):
        cache.frames[key] = CachedDetections(tuple(people[first : first + count]), took_ms)
        first += count
    return cache
