"""People of cloth walk before a wall: their boxes are followed."""

from typing import Any

import numpy as np
import pytest

from common.boxes import iou_xyxy
from common.messages import F64, U8
from services.gait.colour_config import ColourLayerConfig
from services.gait.colour_layer import ColourLayer

SHIRTS = [(200, 40, 40), (40, 60, 200), (40, 170, 60)]
LEGS = [(40, 40, 90), (120, 90, 40), (150, 40, 150)]
WIDTH, HEIGHT = 50.0, 120.0


NOISE = np.random.default_rng(1).normal(0, 6, (480, 640, 3))
WALL = np.random.default_rng(0).integers(90, 160, (30, 40, 3)).repeat(16, 0).repeat(16, 1)


def boxes_at(frame: int, people: int = 1) -> F64:
    """They walk to the right at 2.5 px a frame, one below the other and a little apart."""
    x = 60.0 + 2.5 * frame + 40.0 * np.arange(people)
    y = 70.0 + 130.0 * np.arange(people)
    return np.column_stack([x - WIDTH / 2, y - HEIGHT / 2, x + WIDTH / 2, y + HEIGHT / 2])


def frame_of(boxes: F64) -> U8:
    """A patterned wall, and people of two colours each, with some noise."""
    image = WALL.copy()
    for k, (left, top, right, bottom) in enumerate(boxes.astype(int)):
        middle = (top + bottom) // 2
        image[max(top, 0) : middle, max(left, 0) : right] = SHIRTS[k]
        image[middle:bottom, max(left, 0) : right] = LEGS[k]
    return np.clip(image + NOISE, 0, 255).astype(np.uint8)


def success(people: int = 1, frames: int = 40, seed: int = 0, **fields: Any) -> float:
    """Return the share of boxes with an overlap of half or more."""
    layer = ColourLayer(ColourLayerConfig(**fields), seed)
    first = boxes_at(0, people)
    for k, box in enumerate(first):
        assert layer.start(k, frame_of(first), box)
    hits = []
    for number in range(1, frames):
        boxes = boxes_at(number, people)
        found = layer.update(frame_of(boxes))
        hits += [iou_xyxy(found[k].box_xyxy_px, boxes[k])[0, 0] >= 0.5 for k in range(people)]
    return float(np.mean(hits))


MODELS = [
    {"state": state, "order": order, "sampling": sampling}
    for state in (8, 4)
    for order in (1, 2)
    for sampling in ("plain", "hierarchical")
]


@pytest.mark.parametrize("fields", MODELS, ids=lambda f: "-".join(map(str, f.values())))
def test_a_walker_is_followed_by_every_model(fields: dict[str, Any]) -> None:
    assert success(**fields) >= 0.9


def test_a_box_without_surroundings_does_not_keep_its_size() -> None:
    # Half of a shirt has the colours of a shirt: as in the paper, a fifth of the frames is lost.
    seeds = range(2)
    alone = np.mean([success(seed=seed, surround=0.0) for seed in seeds])
    assert alone < np.mean([success(seed=seed) for seed in seeds])


@pytest.mark.parametrize("estimate", ["weighted_sum", "map", "robust_mean"])
@pytest.mark.parametrize("resampling", ["systematic", "stratified", "residual", "multinomial"])
def test_and_by_every_estimate_and_resampling(estimate: str, resampling: str) -> None:
    assert success(frames=30, estimate=estimate, resampling=resampling) >= 0.95


def test_three_walkers_are_followed_together() -> None:
    assert success(people=3) >= 0.95


def test_the_same_seed_gives_the_same_boxes() -> None:
    def run(seed: int) -> list[list[float]]:
        layer = ColourLayer(ColourLayerConfig(), seed)
        layer.start(7, frame_of(boxes_at(0)), boxes_at(0)[0])
        return [layer.update(frame_of(boxes_at(k)))[7].box_xyxy_px.tolist() for k in range(1, 5)]

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_a_person_who_stays_has_no_distance_and_little_spread() -> None:
    layer = ColourLayer(ColourLayerConfig())
    frame = frame_of(boxes_at(0))
    layer.start(1, frame, boxes_at(0)[0])
    for _ in range(10):
        estimate = layer.update(frame)[1]
    assert estimate.distance < 0.2
    assert np.linalg.norm(estimate.velocity_px) < 3
    assert 0 < estimate.spread_px < 20


def test_a_person_who_is_gone_is_far_from_their_colours() -> None:
    layer = ColourLayer(ColourLayerConfig())
    layer.start(1, frame_of(boxes_at(0)), boxes_at(0)[0])
    for _ in range(5):
        estimate = layer.update(frame_of(np.empty((0, 4))))[1]
    assert estimate.distance > 0.8


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
def test_a_box_that_shows_nothing_is_not_followed(box: list[float]) -> None:
    layer = ColourLayer(ColourLayerConfig())
    assert not layer.start(1, frame_of(boxes_at(0)), np.array(box, float))
    assert layer.people == ()
    assert layer.update(frame_of(boxes_at(0))) == {}


def test_people_come_and_go() -> None:
    layer = ColourLayer(ColourLayerConfig(particles=20))
    frame = frame_of(boxes_at(0, 3))
    for k, box in enumerate(boxes_at(0, 3)):
        layer.start(k, frame, box)
    layer.stop(1)
    layer.stop(1)
    assert list(layer.update(frame)) == [0, 2]
    layer.start(0, frame, boxes_at(0, 3)[0])  # again from here
    assert layer.people == (2, 0)
    assert set(layer.update(frame)) == {0, 2}


def test_whoever_walks_out_of_the_image_does_no_harm() -> None:
    layer = ColourLayer(ColourLayerConfig(particles=30))
    layer.start(1, frame_of(boxes_at(0)), boxes_at(0)[0])
    for number in range(1, 260, 8):  # 650 px to the right, in an image of 640
        (estimate,) = layer.update(frame_of(boxes_at(number)[:1])).values()
        assert np.all(np.isfinite(estimate.box_xyxy_px))


def test_twenty_people_and_frames_of_another_size_do_no_harm() -> None:
    layer = ColourLayer(ColourLayerConfig())
    frame = frame_of(boxes_at(0))
    for k in range(20):
        assert layer.start(k, frame, np.array([10.0 * k, 20, 10.0 * k + 60, 200]))
    assert len(layer.update(frame)) == 20
    assert len(layer.update(frame[:1, :1])) == 20
