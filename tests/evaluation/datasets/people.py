"""People of the virtual lab as data sets annotate them, and an untidy tracker's boxes."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from common.metrics.field_of_view import in_view
from lab.catalogue import load_scenario
from lab.truth.silhouette import silhouettes
from lab.world import World
from people4d.messages import F64
from services.tracker.image_sort.image_sort import BoxTracks

SIZE_PX = (640, 480)


@dataclass(frozen=True)
class AnnotatedPerson:
    """A simulated person in one image."""

    id: int  # from 1
    box_px: tuple[int, int, int, int]  # left, top, width, height
    visible: float  # visible share
    position_m: F64  # 3, torso in the map


@cache
def lab_people(frames: int = 8) -> tuple[tuple[AnnotatedPerson, ...], ...]:
    """Return the people in the images of a scenario, 10 frames a second."""
    world = World(load_scenario("two_crossing"), 1)
    return tuple(_annotated(world, 1.0 + 0.1 * k) for k in range(frames))


def _annotated(world: World, t_s: float) -> tuple[AnnotatedPerson, ...]:
    people, optical_from_map = world.keypoints_m(t_s), world.optical_from_map(t_s)
    found = []
    for k, one in silhouettes(people, optical_from_map, world.info).items():
        left, top, right, bottom = np.clip(one.box_xyxy_px, 0, [*SIZE_PX, *SIZE_PX]).round()
        torso_m = people[k][[5, 6, 11, 12]].mean(axis=0)
        assert in_view(torso_m[None], optical_from_map, world.info).all()
        box = (int(left), int(top), int(right - left), int(bottom - top))
        found.append(AnnotatedPerson(k + 1, box, one.visible_share, torso_m))
    return tuple(found)


@dataclass(frozen=True)
class DrawnBoxes:
    """Annotated boxes and tracks of whole pixels, for comparison with other tools."""

    truth: list[list[tuple[int, tuple[int, int, int, int]]]]  # identity and box of each frame
    tracks: list[BoxTracks]


def drawn_boxes(seed: int = 0, frames: int = 40, people: int = 9) -> DrawnBoxes:
    """Draw people that walk past each other, and tracks with misses, swaps and false alarms."""
    random = np.random.RandomState(seed)  # its draws never change, unlike a Generator's
    corner, step = random.uniform(0, 400, (people, 2)), random.normal(0, 4, (people, 2))
    size = random.randint([30, 60], [60, 160], (people, 2))
    size[-1] = (12, 20)  # a distant person
    names = np.arange(people) + 1
    truth, tracks = [], []
    for frame in range(frames):
        boxes = np.hstack([corner + frame * step, size]).round().astype(int)
        here = random.random_sample(people) < 0.9
        truth.append([(k + 1, tuple(boxes[k].tolist())) for k in np.flatnonzero(here).tolist()])
        if random.random_sample() < 0.1:
            a, b = random.choice(people, 2, replace=False)
            names[[a, b]] = names[[b, a]]
        found = random.random_sample(people) < 0.85
        moved = boxes + random.randint(-6, 7, boxes.shape) * (random.random_sample() < 0.7)
        ids, rows = [*names[found]], [*moved[found]]
        if random.random_sample() < 0.4:
            ids.append(100 + frame)
            rows.append(np.array([random.randint(0, 500), random.randint(0, 300), 40, 22]))
        tracks.append(_tracks(np.array(ids, np.int64), np.array(rows, np.float64).reshape(-1, 4)))
    return DrawnBoxes(truth, tracks)


def _tracks(ids: np.ndarray, ltwh: F64) -> BoxTracks:
    boxes = np.hstack([ltwh[:, :2], ltwh[:, :2] + np.maximum(ltwh[:, 2:], 1)])
    return BoxTracks(ids, boxes, np.ones(len(ids)), np.zeros(len(ids), np.int64))
