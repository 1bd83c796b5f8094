"""SORT in the image: life cycles by hand, and what must always hold."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people4d.messages import F64
from services.tracker.config import ImageSortConfig
from services.tracker.image_sort.image_sort import BoxFrame, BoxTracks, ImageSort

FRAME_NS = 100_000_000
BOX = [100.0, 100, 150, 200]


def frame(number: int, *boxes: list[float], scores: list[float] | None = None) -> BoxFrame:
    return BoxFrame(
        stamp_ns=number * FRAME_NS,
        boxes_xyxy_px=np.array(boxes, np.float64).reshape(-1, 4),
        scores=np.array([0.9] * len(boxes) if scores is None else scores, np.float64),
    )


def results(config: ImageSortConfig, detected: str) -> list[list[int]]:
    """Return the identities of each frame; x: the person is detected, -: not."""
    tracker = ImageSort(config)
    frames = [frame(k, *[BOX] * (mark == "x")) for k, mark in enumerate(detected)]
    return [tracker.update(one).ids.tolist() for one in frames]


def test_life_cycle_of_sort() -> None:
    # In the first 3 frames all are published. T_lost = 1: one miss is survived, but then 3 matches
    # in a row are needed again; the second miss in a row ends the track.
    assert results(ImageSortConfig(), "xx-xxxx") == [[1], [1], [], [], [], [1], [1]]
    assert results(ImageSortConfig(), "xxxx--xxxxx") == [[1]] * 4 + [[]] * 5 + [[2]] * 2


def test_later_track_is_published_after_three_matches() -> None:
    assert results(ImageSortConfig(), "----xxxxx") == [[]] * 7 + [[1], [1]]


def test_tracks_are_published_after_fewer_matches() -> None:
    config = ImageSortConfig(min_hits=1)
    assert results(config, "--xx-xx") == [[], [], [], [1], [], [1], [1]]
    assert results(ImageSortConfig(min_hits=0), "-x") == [[], [1]]


def test_fixed_lifetime() -> None:
    config = ImageSortConfig(min_hits=0, t_lost=2)
    assert results(config, "xxxxxx--x")[-1] == [1]
    assert results(config, "xxxxxx---x")[-1] == [2]


def test_dynamic_lifetime_grows_with_the_frames_tracked() -> None:
    # T_age = min(1 + T_hits / 2, 4): 2 hits give 2 frames, 4 give 3, 100 would give 51 but for 4.
    base = ImageSortConfig(min_hits=0, lifetime="dynamic", r=2, max_age=4)
    for hits, age in ((2, 2), (4, 3), (5, 3), (100, 4)):
        assert results(base, "x" * hits + "-" * age + "x")[-1] == [1]
        assert results(base, "x" * hits + "-" * (age + 1) + "x")[-1] == [2]


def test_prediction_bridges_a_miss() -> None:
    # 20 px a frame, boxes 50 wide: after one miss the old box overlaps by 10/90 < 0.3 only.
    config = ImageSortConfig(min_hits=0)
    moving = [[100.0 + 20 * k, 100, 150 + 20 * k, 200] for k in range(6)]
    tracker = ImageSort(config)
    for k in range(4):
        tracker.update(frame(k, moving[k]))
    tracker.update(frame(4))
    assert tracker.update(frame(5, moving[5])).ids.tolist() == [1]


def scene(seed: int, frames: int = 30, people: int = 5) -> list[BoxFrame]:
    """Randomly walking people with misses, noise and false alarms."""
    rng = np.random.default_rng(seed)
    centre, speed = rng.uniform(50, 550, (people, 2)), rng.normal(0, 6, (people, 2))
    half = rng.uniform(15, 60, (people, 1)) * [1.0, 2.5]
    observed = []
    for number in range(frames):
        centre = centre + speed
        boxes = np.hstack([centre - half, centre + half]) + rng.normal(0, 2, (people, 4))
        boxes = boxes[rng.random(people) < 0.85]
        if rng.random() < 0.3:
            boxes = np.vstack([boxes, [10.0, 10, 40, 90]])
        scores = rng.uniform(0.3, 1.0, len(boxes))
        observed.append(BoxFrame(number * FRAME_NS, boxes, scores))
    return observed


def run(config: ImageSortConfig, frames: list[BoxFrame]) -> list[BoxTracks]:
    tracker = ImageSort(config)
    return [tracker.update(one) for one in frames]


SETTINGS = [
    ImageSortConfig(),
    ImageSortConfig(lifetime="dynamic", r=2, max_age=10),
    ImageSortConfig(min_hits=0),
]
settled = pytest.mark.parametrize("config", SETTINGS)


@settled
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_order_of_detections_changes_only_new_identities(
    config: ImageSortConfig, seed: int
) -> None:
    rng, straight = np.random.default_rng(seed), scene(seed)
    orders = [rng.permutation(len(one.scores)) for one in straight]
    shuffled = [
        BoxFrame(one.stamp_ns, one.boxes_xyxy_px[order], one.scores[order])
        for one, order in zip(straight, orders, strict=True)
    ]
    names: dict[int, int] = {}
    pairs = zip(run(config, straight), run(config, shuffled), orders, strict=True)
    for one, other, order in pairs:
        ids = dict(zip(order[other.detections].tolist(), other.ids.tolist(), strict=True))
        assert sorted(ids) == sorted(one.detections.tolist())
        for detection, identity in zip(one.detections.tolist(), one.ids.tolist(), strict=True):
            assert names.setdefault(identity, ids[detection]) == ids[detection]


@settled
def test_tracks_move_with_the_image(config: ImageSortConfig) -> None:
    shift = np.array([300.0, -40, 300, -40])
    there = [dataclasses.replace(f, boxes_xyxy_px=f.boxes_xyxy_px + shift) for f in scene(8)]
    for one, other in zip(run(config, scene(8)), run(config, there), strict=True):
        np.testing.assert_array_equal(one.ids, other.ids)
        np.testing.assert_allclose(one.boxes_xyxy_px + shift, other.boxes_xyxy_px)


def spoilt(frames: list[BoxFrame]) -> list[BoxFrame]:
    """Return the frames with all faults of a broken detector."""
    junk = np.array(
        [
            [math.nan, 0, 10, 10],
            [0, 0, math.inf, 10],
            [-math.inf, 0, 10, math.inf],
            [50, 50, 50, 90],  # no width
            [50, 90, 70, 50],  # upside down
            [100, 100, 150, 200],  # its score is not a number
        ]
    )
    scores = np.array([0.9] * 5 + [math.nan])
    return [
        BoxFrame(f.stamp_ns, np.vstack([f.boxes_xyxy_px, junk]), np.append(f.scores, scores))
        for f in frames
    ]


@settled
def test_invalid_checkpoint_changes_nothing(config: ImageSortConfig) -> None:
    for one, other in zip(run(config, scene(4)), run(config, spoilt(scene(4))), strict=True):
        np.testing.assert_array_equal(one.ids, other.ids)
        np.testing.assert_array_equal(one.boxes_xyxy_px, other.boxes_xyxy_px)


@settled
def test_huge_and_tiny_boxes_give_no_nan(config: ImageSortConfig) -> None:
    rng, tracker = np.random.default_rng(0), ImageSort(config)
    for number in range(60):
        corner = rng.normal(0, 1, (8, 2)) * 10.0 ** rng.uniform(-6, 8, (8, 1))
        size = 10.0 ** rng.uniform(-9, 9, (8, 2))
        tracks = tracker.update(
            BoxFrame(number * FRAME_NS, np.hstack([corner, corner + size]), rng.random(8))
        )
        assert np.isfinite(tracks.boxes_xyxy_px).all()


def test_returned_arrays_are_copies() -> None:
    tracker, boxes = ImageSort(ImageSortConfig()), np.array([BOX])
    first = tracker.update(BoxFrame(0, boxes, np.array([0.9])))
    before: F64 = first.boxes_xyxy_px.copy()
    tracker.update(BoxFrame(1, boxes + 10, np.array([0.9])))
    np.testing.assert_array_equal(first.boxes_xyxy_px, before)
    np.testing.assert_array_equal(boxes, [BOX])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"min_hits": -1}, "min_hits: expected >= 0, got -1"),
        ({"t_lost": -1.0}, "t_lost: expected a finite number >= 0, got -1.0"),
        ({"r": 0.0}, "r: expected > 0, got 0.0"),
    ],
)
def test_wrong_values_are_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        ImageSortConfig(**wrong)
