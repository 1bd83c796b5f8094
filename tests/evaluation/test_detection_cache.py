"""The cache stores detections exactly, and the network runs once for each image."""

from pathlib import Path

import numpy as np
import pytest

from evaluation.recordings.detection_cache import (
    CachedDetections,
    CachingModel,
    DetectionCache,
    digest,
    load,
    save,
)
from people4d.messages import U8
from services.detector.models.base import DetectedPerson, InstanceMask


def image(value: int) -> U8:
    return np.full((4, 6, 3), value, np.uint8)


def person(score: float, mask: InstanceMask | None = None, points: bool = True) -> DetectedPerson:
    keypoints = np.arange(51, dtype=np.float32).reshape(17, 3) + np.float32(score)
    box = np.array([-1.5, 2.25, 30.0, 40.0], np.float32)
    return DetectedPerson(score, box, keypoints if points else None, mask)


class Counting:
    """Finds as many people as the first pixel says."""

    name = "counting"

    def __init__(self) -> None:
        self.asked = 0

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        self.asked += 1
        return [person(0.5)] * int(rgb[0, 0, 0])


def test_a_network_runs_once_for_each_image() -> None:
    model, known = Counting(), DetectionCache()
    memory = CachingModel(model, known)
    assert [len(memory.detect(image(v))) for v in (1, 2, 1, 0, 0)] == [1, 2, 1, 0, 0]
    assert model.asked == 3  # the second 1 and the second 0 were known
    assert memory.changed
    again = CachingModel(model, known)
    assert len(again.detect(image(2))) == 2
    assert model.asked == 3
    assert not again.changed


def test_saved_time_is_returned_once() -> None:
    known = DetectionCache("counting", {digest(image(3)): CachedDetections((), 40.0)})
    memory = CachingModel(Counting(), known)
    memory.detect(image(3))
    assert memory.saved_ms() == 40.0
    assert memory.saved_ms() == 0.0


def test_a_cache_is_read_as_it_was_written(tmp_path: Path) -> None:
    # 3 x 5 = 15 pixels are two bytes, of which one bit is padding.
    window = (np.arange(15).reshape(3, 5) % 2).astype(np.uint8)
    people = (
        person(0.9, InstanceMask(window, 7, 11)),
        person(0.1, points=False),
        person(0.8, InstanceMask(np.ones((1, 8), np.uint8), 0, 0)),
    )
    stored = DetectionCache(
        "seg", {2**64 - 1: CachedDetections(people, 12.5), 5: CachedDetections((), 3.0)}
    )
    save(tmp_path / "a" / "f.npz", stored)
    back = load(tmp_path / "a" / "f.npz")
    assert back.name == "seg"
    assert list(back.frames) == [2**64 - 1, 5]
    assert back.frames[5] == CachedDetections((), 3.0)
    assert back.frames[2**64 - 1].took_ms == 12.5
    for got, want in zip(back.frames[2**64 - 1].people, people, strict=True):
        assert got.score == want.score
        np.testing.assert_array_equal(got.box_xyxy_px, want.box_xyxy_px)
        assert (got.keypoints is None) == (want.keypoints is None)
        if got.keypoints is not None:
            np.testing.assert_array_equal(got.keypoints, want.keypoints)
        assert (got.mask is None) == (want.mask is None)
        if got.mask is not None and want.mask is not None:
            assert (got.mask.x_px, got.mask.y_px) == (want.mask.x_px, want.mask.y_px)
            np.testing.assert_array_equal(got.mask.window, want.mask.window)


@pytest.mark.parametrize("damage", ["absent", "empty", "cut"])
def test_a_damaged_file_gives_an_empty_cache(tmp_path: Path, damage: str) -> None:
    file = tmp_path / "f.npz"
    save(file, DetectionCache("seg", {5: CachedDetections((person(0.5),), 3.0)}))
    data = file.read_bytes()
    if damage == "absent":
        file.unlink()
    else:
        file.write_bytes(b"" if damage == "empty" else data[: len(data) // 2])
    assert load(file).frames == {}
