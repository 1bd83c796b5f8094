"""The gait node on a person of one colour before a wall, whose place is known by hand."""

import sys
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from people4d.codec import decode, encode
from people4d.messages import (
    CameraInfo,
    Detection,
    Detections,
    Gait,
    Message,
    Odometry,
    RgbdFrame,
    StaticTransform,
    Track,
    Tracks,
)
from services.gait.build import build
from services.gait.config import GaitConfig
from services.gait.node import GaitNode
from services.gait.people import fixed_point
from services.gait.points.point_filter import PointEstimate
from services.gait.warm_up import warm_up

HEIGHT, WIDTH, FOCAL_PX = 120, 160, 120.0
DEPTH_M = 2.5
PERIOD_NS = 33_000_000
BOX = (68.0, 18.0, 92.0, 112.0)
OPTICAL = "front_optical_frame"

INFO = CameraInfo(
    stamp_ns=0,
    sequence=0,
    camera="front",
    frame_id=OPTICAL,
    width=WIDTH,
    height=HEIGHT,
    fx=FOCAL_PX,
    fy=FOCAL_PX,
    cx=80.0,
    cy=60.0,
)


def frame(number: int, lockstep: bool = True, height: int = HEIGHT) -> RgbdFrame:
    """Return somebody with head, trunk and legs, 2.5 m away before a wall."""
    rgb = np.full((height, WIDTH, 3), (120, 130, 140), np.uint8)
    depth_mm = np.full((height, WIDTH), 4000, np.uint16)
    for rows, columns in (
        (slice(20, 33), slice(75, 85)),
        (slice(33, 70), slice(70, 90)),
        (slice(70, 110), slice(70, 78)),
        (slice(70, 110), slice(82, 90)),
    ):
        rgb[rows, columns] = (200, 40, 40)
        depth_mm[rows, columns] = round(DEPTH_M * 1000)
    stamp_ns = number * PERIOD_NS
    return RgbdFrame(
        stamp_ns=stamp_ns,
        sequence=number,
        camera="front",
        rgb=rgb,
        depth_mm=depth_mm,
        lockstep=lockstep,
    )


def detections(number: int, people: int = 1) -> Detections:
    one = Detection(
        box_xyxy_px=np.array(BOX, np.float32), score=0.9, position_m=np.array([0.0, 0.0, DEPTH_M])
    )
    return Detections(
        stamp_ns=number * PERIOD_NS,
        sequence=number,
        camera="front",
        frame_id=OPTICAL,
        model="test",
        width=WIDTH,
        height=HEIGHT,
        detections=(one,) * people,
    )


def track(key: int = 1, detection: int | None = 0, x_m: float = DEPTH_M) -> Track:
    return Track(
        id=key,
        state="lost" if detection is None else "confirmed",
        position_m=np.array([x_m, 0.0, 0.0]),
        velocity_mps=np.zeros(3),
        covariance=np.eye(6),
        yaw_rad=None,
        hits=5,
        age=5,
        time_since_update_s=0.0,
        detection=detection,
        score=0.9,
    )


def tracks(number: int, *people: Track) -> Tracks:
    return Tracks(
        stamp_ns=number * PERIOD_NS,
        sequence=number,
        frame_id="map",
        tracker="test",
        camera="front",
        tracks=people,
    )


def moment(number: int, *people: Track, lockstep: bool = True) -> list[Message]:
    return [
        frame(number, lockstep),
        detections(number),
        tracks(number, *(people or (track(),))),
    ]


def feed(node: GaitNode, messages: Sequence[Message], now_ns: int = 0) -> list[Gait]:
    answers = [answer for message in messages for answer in node.handle(message, now_ns)]
    assert all(isinstance(answer, Gait) for answer in answers)
    return [answer for answer in answers if isinstance(answer, Gait)]


def calibrated(config: GaitConfig | None = None) -> GaitNode:
    node = build(config or GaitConfig())
    feed(node, [INFO])
    return node


def test_a_frame_with_its_people_is_told_where_they_are() -> None:
    (told,) = feed(calibrated(), moment(3))
    assert (told.stamp_ns, told.sequence, told.frame_id) == (3 * PERIOD_NS, 3, "map")
    (person,) = told.people
    points = {point.name: point for point in person.points}
    # Without transforms the camera looks along x from the origin: the person is at x = 2.5 m. The
    # head's middle is at row 26, (26 - 60) / 120 * 2.5 m = -0.71 m from the axis: 0.71 m up. The
    # feet end at row 110: (110 - 60) / 120 * 2.5 m = 1.04 m down.
    assert points["head"].position_m == pytest.approx([DEPTH_M, 0.0, 0.71], abs=0.2)
    feet = [points[name].position_m for name in ("left_foot", "right_foot") if name in points]
    assert feet
    for place in feet:
        assert place[[0, 2]] == pytest.approx([DEPTH_M, -1.04], abs=0.2)
    assert person.measures.steps == 0


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_the_order_of_arrival_does_not_matter(order: tuple[int, ...]) -> None:
    messages = moment(1)
    (told,) = feed(calibrated(), [messages[k] for k in order])
    (usual,) = feed(calibrated(), messages)
    for ours, theirs in zip(told.people[0].points, usual.people[0].points, strict=True):
        np.testing.assert_array_equal(ours.position_m, theirs.position_m)


def test_points_are_told_in_the_frame_of_the_tracks() -> None:
    # The camera is a metre up and looks along y: optical x, y, z are map x, -z, y.
    pose = np.array([[1.0, 0, 0, 5], [0, 0, 1, 0], [0, -1, 0, 1], [0, 0, 0, 1]])
    node = calibrated()
    transform = StaticTransform(stamp_ns=0, sequence=0, parent="map", child=OPTICAL, matrix=pose)
    (told,) = feed(node, [transform, *moment(1)])
    head = next(point for point in told.people[0].points if point.name == "head")
    assert head.position_m == pytest.approx([5.0, DEPTH_M, 1.71], abs=0.2)


def test_of_frames_that_wait_the_newest_is_done() -> None:
    """Live: what takes long must not fall behind."""
    node = calibrated(GaitConfig(settle_s=0.003))
    assert not feed(node, [*moment(1, lockstep=False), *moment(2, lockstep=False)], now_ns=0)
    assert node.wake_ns() == 3_000_000
    assert not node.tick(2_000_000)
    (told,) = node.tick(3_000_000)
    assert told.stamp_ns == 2 * PERIOD_NS
    assert node.status().counters["passed_over"] == 1
    assert node.wake_ns() is None
    assert not node.tick(9_000_000)


def test_in_lockstep_every_frame_is_done() -> None:
    told = feed(calibrated(), [message for k in range(4) for message in moment(k)])
    assert [one.sequence for one in told] == [0, 1, 2, 3]


def test_tracks_whose_frame_was_dropped_are_counted() -> None:
    node = calibrated()
    assert not feed(node, moment(1)[1:])
    assert not feed(node, moment(2)[:1])
    assert len(feed(node, moment(3))) == 1
    counters = node.status().counters
    assert (counters["without_frame"], counters["frames_unused"]) == (1, 1)


def test_frames_that_nobody_asks_for_are_forgotten() -> None:
    node = calibrated(GaitConfig(frames=4))
    feed(node, [frame(k) for k in range(10)])
    assert node.status().counters["frames_unused"] == 6
    # 5 is gone, 6 is still there.
    assert not feed(node, moment(5)[1:])
    assert len(feed(node, moment(6)[1:])) == 1


def test_what_cannot_be_used_is_counted() -> None:
    node = build(GaitConfig())
    feed(node, moment(1))
    feed(node, [INFO, frame(2, height=60), *moment(2)[1:]])
    feed(node, [*moment(4), *moment(3), *moment(4)])
    counters = node.status().counters
    assert counters["no_camera_info"] == counters["wrong_size"] == 1
    assert counters["stale"] == 2


def test_a_clock_that_goes_back_begins_anew() -> None:
    node = calibrated()
    assert len(feed(node, [*moment(100), *moment(1), *moment(2)])) == 3
    assert node.status().counters["clock_resets"] == 1


def test_a_person_who_was_never_seen_is_not_followed() -> None:
    lost = track(7, detection=None)
    (told,) = feed(calibrated(), moment(1, track(), lost))
    assert [person.id for person in told.people] == [1]


def test_a_person_who_is_not_detected_is_carried_on_by_colour() -> None:
    told = feed(calibrated(), [m for k in range(5) for m in moment(k)])
    node = calibrated()
    feed(node, moment(1))
    (told_on,) = feed(node, moment(2, track(detection=None)))
    assert told[-1].people
    (person,) = told_on.people
    assert person.box_xyxy_px == pytest.approx(BOX, abs=12)
    assert any(point.state == "measured" for point in person.points)


def test_of_a_crowd_the_nearest_are_told() -> None:
    crowd = [track(k, None if k > 3 else 0, x_m=float(k)) for k in range(1, 21)]
    node = calibrated(GaitConfig(people_max=2))
    (told,) = feed(node, moment(1, *crowd))
    assert len(told.people) == 2
    assert node.status().counters["over_budget"] == 1  # of the three who are seen


def test_a_frame_without_people_is_told_too() -> None:
    (told,) = feed(calibrated(), [frame(1), detections(1, people=0), tracks(1)])
    assert told.people == ()


def test_points_move_with_a_camera_that_drives() -> None:
    mounted = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]])
    node = calibrated()
    feed(
        node,
        [StaticTransform(stamp_ns=0, sequence=0, parent="base", child=OPTICAL, matrix=mounted)],
    )
    for k in (0, 1, 2):
        odometry = Odometry(
            stamp_ns=k * PERIOD_NS,
            sequence=k,
            frame_id="map",
            child_frame_id="base",
            x_m=0.1 * k,
            y_m=0.0,
            theta_rad=0.0,
        )
        feed(node, [odometry])
    told = feed(node, [*moment(0), *moment(1), *moment(2)])
    heads = [next(p for p in one.people[0].points if p.name == "head") for one in told]
    # The person keeps their distance from the camera, so they moved by 0.1 m with it.
    moved_m = heads[2].position_m - heads[1].position_m
    assert moved_m[0] == pytest.approx(0.1, abs=0.05)
    assert len(told) == 3


def test_a_point_at_rest_seen_from_a_camera_that_drives_rests() -> None:
    # The camera drives along its axis with 0.5 m/s and turns with 0.2 rad/s about y: a point at
    # p = (1, 0, 3) m comes nearer by 0.5 m/s and moves with -omega x p = -(0.6, 0, -0.2) m/s.
    motion = np.zeros((4, 4))
    motion[:3, :3] = 0.2 * np.array([[0, 0, 1], [0, 0, 0], [-1, 0, 0]])
    motion[2, 3] = 0.5
    seen = PointEstimate(
        position_m=np.array([1.0, 0.0, 3.0]),
        velocity_mps=np.array([-0.6, 0.0, 0.2 - 0.5]),
        covariance=np.eye(6),
        state="measured",
        confidence=1.0,
    )
    told = fixed_point("head", seen, np.eye(4), motion)
    assert told is not None
    assert told.velocity_mps == pytest.approx([0, 0, 0], abs=1e-12)


def test_a_point_that_was_never_seen_is_not_told() -> None:
    unknown = PointEstimate(np.full(3, np.nan), np.zeros(3), np.eye(6), "lost", 0.0)
    assert fixed_point("head", unknown, np.eye(4), np.zeros((4, 4))) is None


def test_who_watches_sees_what_is_told() -> None:
    seen = []
    node = build(GaitConfig(), lambda info, scene, found: seen.append((info, scene, found)))
    feed(node, [INFO])
    (told,) = feed(node, moment(1))
    ((info, scene, found),) = seen
    assert info.camera == "front"
    assert scene.stamp_ns == told.stamp_ns
    assert tuple(one.person for one in found) == told.people


@pytest.mark.parametrize(
    "fields",
    [{"people_max": 0}, {"frames": 0}, {"clock_jump_s": 0.0}, {"settle_s": 1.0}],
    ids=lambda fields: next(iter(fields)),
)
def test_a_wrong_configuration_is_told(fields: dict[str, int]) -> None:
    with pytest.raises(ValueError, match=next(iter(fields))):
        msgspec.structs.replace(GaitConfig(), **fields)


def test_after_warming_up_nothing_is_left_to_compile() -> None:
    """A process that compiles while it has a frame in hand looks as if it hung."""
    warm_up(GaitConfig())
    before = compiled_functions()
    node = calibrated()
    read_only = [decode(encode(m)) for k in range(4) for m in moment(k, track(), track(2))]
    assert feed(node, read_only)
    assert compiled_functions() == before
    assert sum(before.values()) > 5


def compiled_functions() -> dict[str, int]:
    """Return for how many kinds of arguments each function is compiled by now."""
    return {
        f"{module}.{name}": len(function.signatures)
        for module, found in tuple(sys.modules.items())
        if module.startswith("services.gait.")
        for name, function in vars(found).items()
        if hasattr(function, "signatures")
    }
