"""SORT in the image in the node: people with and without depth, turns, restarts."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from people4d.messages import (
    CameraInfo,
    Detection,
    ImageTracks,
    Message,
    MovingTransform,
    Odometry,
    StaticTransform,
    Tracks,
)
from services.tracker.config import ImageSortConfig
from services.tracker.image_sort.camera_turn import camera_direction
from services.tracker.node import TrackerNode
from tests import builders
from tests.tracker.test_node import FRAME_MS, MS, START_NS, TRANSFORM, detected, node, person

AT_ONCE = {"min_hits": 0}
INFO = CameraInfo(
    stamp_ns=0,
    sequence=0,
    camera="front",
    frame_id="camera_optical",
    width=640,
    height=480,
    fx=320 / math.tan(math.radians(30)),  # 60 degrees
    fy=320 / math.tan(math.radians(30)),
    cx=320.0,
    cy=240.0,
)


def image_node(sort: dict[str, Any] = AT_ONCE, **fields: Any) -> TrackerNode:
    return node(tracker="image_sort", image_sort=ImageSortConfig(**sort), **fields)


def answers(target: TrackerNode, *messages: Message) -> list[tuple[ImageTracks, Tracks]]:
    results = [output for message in messages for output in target.handle(message, 0)]
    pairs = list(zip(results[::2], results[1::2], strict=True))
    for boxes, tracks in pairs:
        assert isinstance(boxes, ImageTracks)
        assert isinstance(tracks, Tracks)
        assert boxes.stamp_ns == tracks.stamp_ns
    return pairs  # type: ignore[return-value]


def flat(left: float, width: float = 100.0) -> Detection:
    """Detection without depth."""
    return Detection(box_xyxy_px=np.array([left, 100, left + width, 400], np.float32), score=0.9)


def test_people_without_depth_are_published_in_the_image_only() -> None:
    target = image_node()
    ((boxes, tracks),) = answers(target, TRANSFORM, detected(0, [person(0.0), flat(0.0)]))
    assert (boxes.camera, boxes.tracker, boxes.width, boxes.height) == (
        "front",
        "image_sort",
        640,
        480,
    )
    assert [(p.id, p.state, p.detection, p.hits) for p in boxes.tracks] == [
        (1, "confirmed", 0, 1),
        (2, "confirmed", 1, 1),
    ]
    assert boxes.tracks[1].box_xyxy_px == pytest.approx([0, 100, 100, 400])
    # The camera stands at (10, 0, 1) and looks along +x: 3 m ahead is (13, 0, 1).
    assert [(p.id, p.detection) for p in tracks.tracks] == [(1, 0)]
    np.testing.assert_allclose(tracks.tracks[0].position_m, [13, 0, 1])
    assert target.status().counters["without_position"] == 1


def test_identity_is_stable_while_depth_is_intermittent() -> None:
    people = [flat(320), person(0.0), flat(320), person(0.0)]
    results = answers(image_node(), TRANSFORM, *(detected(k, [p]) for k, p in enumerate(people)))
    assert [[p.id for p in boxes.tracks] for boxes, _ in results] == [[1]] * 4
    # Without depth a known position is predicted.
    assert [[(p.id, p.state) for p in tracks.tracks] for _, tracks in results] == [
        [],
        [(1, "confirmed")],
        [(1, "lost")],
        [(1, "confirmed")],
    ]


def test_life_cycle_of_sort_in_both_messages() -> None:
    # SORT [Bewley 2016]: T_lost = 1, published again after 3 matches in a row; lost and
    # tentative tracks are published only where configured.
    frames = [
        detected(k, [person()] if mark == "x" else []) for k, mark in enumerate("xxxx-xxxx--x")
    ]
    results = answers(image_node({}, publish_lost=False), TRANSFORM, *frames)
    ids = [[p.id for p in tracks.tracks] for _, tracks in results]
    assert ids == [[1]] * 4 + [[]] * 3 + [[1]] * 2 + [[]] * 3
    assert ids == [[p.id for p in boxes.tracks] for boxes, _ in results]
    all_ = answers(image_node({}, publish_tentative=True), TRANSFORM, *frames)
    states = ["".join(p.state[0] for p in boxes.tracks) for boxes, _ in all_]
    assert states == ["c"] * 4 + ["l", "t", "t", "c", "c", "l", "", "t"]
    ends = [[p.id for p in tracks.tracks] for _, tracks in all_][-3:]
    assert ends == [[1], [], []]  # the second miss in a row ends the track


def test_speed_is_that_of_the_person() -> None:
    # 0.05 m to the right of the camera, which is -y in the map, in each tenth of a second.
    frames = [detected(k, [person(-1.0 + 0.05 * k)]) for k in range(40)]
    results = answers(image_node(), TRANSFORM, *frames)
    np.testing.assert_allclose(results[-1][1].tracks[0].velocity_mps, [0, -0.5, 0], atol=0.05)


def odometry(number: int, theta_rad: float) -> Odometry:
    return builders.odometry(
        stamp_ns=START_NS + number * FRAME_MS * MS,
        sequence=number,
        frame_id="map",
        theta_rad=theta_rad,
    )


def on(parent: str) -> StaticTransform:
    """The camera, level and looking ahead."""
    return builders.static_transform(LINK_FROM_OPTICAL, parent=parent, child="camera_optical")


def ids_while_turning(target: TrackerNode, moved: Sequence[Message], step_px: float) -> list[int]:
    """Return the identities of a person 40 px wide while the camera turns in every third frame."""
    left, ids = 100.0, []
    for number, message in enumerate(moved):
        left += step_px * (number % 3 == 2)
        for boxes, _ in answers(target, message, detected(number, [flat(left, 40.0)])):
            ids += [p.id for p in boxes.tracks]
    return ids


@pytest.mark.parametrize("projection", ["linear", "pinhole"])
def test_a_robot_that_turns_left_sees_the_image_move_right(projection: str) -> None:
    # 60 degrees are 640 px wide: 30 px are 2.8125 degrees. Boxes of 40 px then overlap by 10 / 70.
    step_rad = math.radians(60 * 30 / 640)
    thetas = np.cumsum([step_rad * (k % 3 == 2) for k in range(12)]).tolist()
    moved = [odometry(k, theta) for k, theta in enumerate(thetas)]
    corrected = {**AT_ONCE, "ego_motion": "odometry", "projection": projection}

    def ids(sort: dict[str, Any], step_px: float) -> list[int]:
        target = image_node(sort, frame_id="map")
        answers(target, INFO, on("base_link"))
        return ids_while_turning(target, moved, step_px)

    assert ids(corrected, 30.0) == [1] * 12
    assert ids(AT_ONCE, 30.0)[-1] > 3
    assert ids(corrected, -30.0)[-1] > 3  # the wrong sign is worse than none


def test_a_camera_on_a_turning_head_needs_no_odometry() -> None:
    step_rad = math.radians(60 * 30 / 640)
    thetas = np.cumsum([step_rad * (k % 3 == 2) for k in range(12)]).tolist()
    moved = [
        MovingTransform(
            stamp_ns=START_NS + k * FRAME_MS * MS,
            sequence=k,
            parent="map",
            child="head",
            matrix=transform_from((0, 0, 1), rotation_from_rpy(0, 0, theta)),
        )
        for k, theta in enumerate(thetas)
    ]
    target = image_node({**AT_ONCE, "ego_motion": "odometry"})
    answers(target, INFO, on("head"))
    assert ids_while_turning(target, moved, 30.0) == [1] * 12


def test_directions_of_cameras() -> None:
    # Rolling, pitching (nose up is negative about y) and yawing, as the optical axis shows them.
    def direction(roll: float, pitch: float, yaw: float) -> Any:
        link = transform_from((1, 2, 3), rotation_from_rpy(roll, pitch, yaw))
        return camera_direction(link @ LINK_FROM_OPTICAL, 0.1)

    assert direction(0, 0, 0.5) == pytest.approx((0.5, 0.0, 0.01))
    assert direction(0.3, -0.2, -1.0) == pytest.approx((-1.0, 0.2, 0.01))
    assert direction(0, math.pi / 2, 0) is None
    assert camera_direction(None) is None


def test_cameras_share_identities_but_not_images() -> None:
    # The same box in two images is two people.
    other = builders.static_transform(LINK_FROM_OPTICAL, child="side_optical")
    target = image_node(reorder_wait_s=0.0)
    answers(target, TRANSFORM, other)
    results = []
    for k in range(3):
        results += answers(
            target, detected(k, [flat(100)]), detected(k, [flat(100)], camera="side", late_ms=5)
        )
    assert [(b.camera, [p.id for p in b.tracks]) for b, _ in results] == [
        ("front", [1]),
        ("side", [2]),
    ] * 3


def restarted(before: TrackerNode) -> TrackerNode:
    after = image_node()
    after.restore(before.save(), before.next_number())
    return after


@pytest.mark.parametrize("pause", [1, 20, 100])
def test_identities_outlive_the_process(pause: int) -> None:
    before = image_node()
    answers(before, TRANSFORM, *(detected(k, [person(), flat(0)]) for k in range(5)))
    after = restarted(restarted(before))
    results = answers(
        after, *(detected(k, [person(), flat(0), flat(500)]) for k in range(4 + pause, 7 + pause))
    )
    for boxes, tracks in results:
        assert [p.id for p in boxes.tracks] == [1, 2, 3]
        assert [p.id for p in tracks.tracks] == [1]
    assert after.next_number() == 4


def test_unusable_boxes_are_ignored_and_indices_stay() -> None:
    empty = Detection(box_xyxy_px=np.array([5, 5, 5, 9], np.float32), score=0.9)
    far = Detection(
        box_xyxy_px=np.array([0, 0, 50, 100], np.float32), score=0.9, position_m=np.full(3, 9e6)
    )
    ((boxes, tracks),) = answers(image_node(), TRANSFORM, detected(0, [empty, far, person()]))
    assert [p.detection for p in boxes.tracks] == [1, 2]
    assert [p.detection for p in tracks.tracks] == [2]
    assert answers(image_node(), TRANSFORM, detected(0, []))[0][0].tracks == ()
