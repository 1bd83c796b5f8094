"""Boxes of coloured figures that walk before a wall."""

from typing import Any

import numpy as np
import pytest

from common.geometry.boxes import iou_xyxy
from people4d.messages import F64, U8
from services.gait.colour.colour_layer import ColourLayer
from services.gait.config import PUBLISHED_TAU, ColourLayerConfig

SHIRTS = [(200, 40, 40), (40, 60, 200), (40, 170, 60)]
LEGS = [(40, 40, 90), (120, 90, 40), (150, 40, 150)]
HAIR = (60, 40, 20)
WIDTH, HEIGHT = 50.0, 120.0

NOISE = np.random.default_rng(1).normal(0, 6, (480, 640, 3))
WALL = np.random.default_rng(0).integers(90, 160, (30, 40, 3)).repeat(16, 0).repeat(16, 1)


def boxes_at(frame: int, people: int = 1) -> F64:
    """Two people walk to the right at 2.5 px a frame, one below the other and a little apart."""
    x = 60.0 + 2.5 * frame + 40.0 * np.arange(people)
    y = 70.0 + 130.0 * np.arange(people)
    return np.column_stack([x - WIDTH / 2, y - HEIGHT / 2, x + WIDTH / 2, y + HEIGHT / 2])


def frame_of(boxes: F64) -> U8:
    """A patterned wall, and people of two colours and a small head each, with some noise."""
    image = WALL.copy()
    for k, (left, top, right, bottom) in enumerate(boxes.astype(int)):
        neck, hips = top + (bottom - top) // 7, (top + bottom) // 2
        for rows, inset, colour in (
            (slice(max(top, 0), neck), 0.3, HAIR),
            (slice(neck, hips), 0.1, SHIRTS[k]),
            (slice(hips, bottom), 0.15, LEGS[k]),
        ):
            aside = round(inset * (right - left))
            image[rows, max(left + aside, 0) : max(right - aside, 0)] = colour
    return np.clip(image + NOISE, 0, 255).astype(np.uint8)


def success(people: int = 1, frames: int = 40, seed: int = 0, **fields: Any) -> float:
    """Return the share of boxes with an overlap of half or more."""
    layer = ColourLayer(ColourLayerConfig(**fields), seed)
    first = boxes_at(0, people)
    for k, box in enumerate(first):
        assert layer.start_person(k, frame_of(first), box)
    hits = []
    for number in range(1, frames):
        boxes = boxes_at(number, people)
        found = layer.update_boxes(frame_of(boxes))
        hits += [iou_xyxy(found[k].box_xyxy_px, boxes[k])[0, 0] >= 0.5 for k in range(people)]
    return float(np.mean(hits))


MODELS = [
    {"state": state, "order": order, "sampling": sampling}
    for state in (8, 4)
    for order in (1, 2)
    for sampling in ("plain", "hierarchical")
]


PUBLISHED: dict[str, Any] = {"weights": "distance", "tau": PUBLISHED_TAU}


@pytest.mark.slow
@pytest.mark.parametrize("fields", MODELS, ids=lambda f: "-".join(map(str, f.values())))
def test_walking_person_is_tracked_by_every_model(fields: dict[str, Any]) -> None:
    assert success(**fields) >= 0.9


@pytest.mark.slow
@pytest.mark.parametrize("fields", MODELS[::3], ids=lambda f: "-".join(map(str, f.values())))
def test_walking_person_is_mostly_tracked_with_published_constants(fields: dict[str, Any]) -> None:
    assert success(**fields, **PUBLISHED) >= 0.5


def success_before_a_shelf(**fields: Any) -> float:
    """Return the success for a person in front of a board with the same colours, upside down."""

    def frame(number: int) -> U8:
        image = frame_of(np.array([[150.0, 10.0, 200.0, 130.0]]))
        image[10:130, 150:200] = image[129:9:-1, 150:200]
        left, top, right, bottom = boxes_at(number)[0].astype(int)
        image[top:bottom, left:right] = frame_of(boxes_at(number))[top:bottom, left:right]
        return image

    layer = ColourLayer(ColourLayerConfig(**fields))
    layer.start_person(0, frame(0), boxes_at(0)[0])
    hits = [
        iou_xyxy(layer.update_boxes(frame(k))[0].box_xyxy_px, boxes_at(k)[0])[0, 0] >= 0.5
        for k in range(1, 70)
    ]
    return float(np.mean(hits))


@pytest.mark.slow
def test_shelf_of_the_same_colours_does_not_attract_the_box() -> None:
    assert success_before_a_shelf() >= 0.95
    # A histogram of the entire box does not distinguish them.
    assert success_before_a_shelf(**PUBLISHED) < 0.7


@pytest.mark.slow
def test_box_of_an_approaching_person_grows() -> None:
    # The height grows from 120 to 240 px in 80 frames, as in a walk from 4 m to 2 m.
    def box(frame: int) -> F64:
        half = np.array([WIDTH, HEIGHT]) / 2 * 2 ** (frame / 80)
        return np.array([[320 - half[0], 240 - half[1], 320 + half[0], 240 + half[1]]])

    layer = ColourLayer(ColourLayerConfig())
    layer.start_person(0, frame_of(box(0)), box(0)[0])
    for k in range(1, 81):
        found = layer.update_boxes(frame_of(box(k)))[0].box_xyxy_px
    assert iou_xyxy(found, box(80)[0])[0, 0] >= 0.7


@pytest.mark.slow
def test_three_people_are_tracked_together() -> None:
    assert success(people=3) >= 0.95


def test_the_same_seed_gives_the_same_boxes() -> None:
    def run(seed: int) -> list[list[float]]:
        layer = ColourLayer(ColourLayerConfig(), seed)
        layer.start_person(7, frame_of(boxes_at(0)), boxes_at(0)[0])
        return [
            layer.update_boxes(frame_of(boxes_at(k)))[7].box_xyxy_px.tolist() for k in range(1, 5)
        ]

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_distance_is_small_at_rest_and_large_without_the_person() -> None:
    layer, frame = ColourLayer(ColourLayerConfig()), frame_of(boxes_at(0))
    layer.start_person(1, frame, boxes_at(0)[0])
    for _ in range(10):
        estimate = layer.update_boxes(frame)[1]
    assert iou_xyxy(estimate.box_xyxy_px, boxes_at(0)[0])[0, 0] > 0.85
    assert estimate.distance < 0.5
    for _ in range(5):
        estimate = layer.update_boxes(frame_of(np.empty((0, 4))))[1]
    assert estimate.distance > 0.7


@pytest.mark.parametrize(
    "box",
    [
        [10, 10, 10, 10],
        [50, 50, 10, 10],
        [0, 0, 1, 1],
        [5000, 5000, 5100, 5100],
        [np.nan, 0, 9, 9],
        [0, 0, np.inf, 9],
    ],
)
def test_invalid_box_is_not_tracked(box: list[float]) -> None:
    layer = ColourLayer(ColourLayerConfig())
    assert not layer.start_person(1, frame_of(boxes_at(0)), np.array(box, float))
    assert layer.people == ()
    assert layer.update_boxes(frame_of(boxes_at(0))) == {}


def test_people_start_stop_and_start_again() -> None:
    layer = ColourLayer(ColourLayerConfig(particles=20))
    frame = frame_of(boxes_at(0, 3))
    for k, box in enumerate(boxes_at(0, 3)):
        layer.start_person(k, frame, box)
    layer.stop_person(1)
    layer.stop_person(1)
    assert list(layer.update_boxes(frame)) == [0, 2]
    layer.start_person(0, frame, boxes_at(0, 3)[0])  # again from here
    assert layer.people == (2, 0)
    assert set(layer.update_boxes(frame)) == {0, 2}


def test_box_leaving_the_image_stays_finite() -> None:
    layer = ColourLayer(ColourLayerConfig(particles=30))
    layer.start_person(1, frame_of(boxes_at(0)), boxes_at(0)[0])
    for number in range(1, 260, 8):  # 650 px to the right, in an image of 640
        (estimate,) = layer.update_boxes(frame_of(boxes_at(number)[:1])).values()
        assert np.all(np.isfinite(estimate.box_xyxy_px))


def test_twenty_people_and_small_frames_are_tracked() -> None:
    layer = ColourLayer(ColourLayerConfig())
    frame = frame_of(boxes_at(0))
    for k in range(20):
        assert layer.start_person(k, frame, np.array([10.0 * k, 20, 10.0 * k + 60, 200]))
    assert len(layer.update_boxes(frame)) == 20
    assert len(layer.update_boxes(frame[:1, :1])) == 20
