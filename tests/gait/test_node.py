"""The gait node on a person of one colour before a wall, at a known position."""

import math
import sys
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from people4d.codec import decode, encode
from people4d.messages import Detection, Detections, Gait, Message, RgbdFrame, Track, Tracks
from services.gait.build import build, warm_up
from services.gait.config import GaitConfig
from services.gait.estimator import to_fixed_frame
from services.gait.node import GaitNode
from services.gait.points.point_filter import PointEstimate
from tests import builders

HEIGHT, WIDTH, FOCAL_PX = 120, 160, 120.0
DEPTH_M = 2.5
PERIOD_NS = 33_000_000
BOX = (68.0, 18.0, 92.0, 112.0)
OPTICAL = "front_optical_frame"

INFO = builders.camera_info(
    frame_id=OPTICAL, width=WIDTH, height=HEIGHT, fx=FOCAL_PX, cx=80.0, cy=60.0
)


def frame(number: int, lockstep: bool = True, height: int = HEIGHT) -> RgbdFrame:
    """Return a person with head, torso and legs, 2.5 m away before a wall."""
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
    return builders.detections(
        stamp_ns=number * PERIOD_NS,
        sequence=number,
        frame_id=OPTICAL,
        width=WIDTH,
        height=HEIGHT,
        detections=(one,) * people,
    )


def track(key: int = 1, detection: int | None = 0, x_m: float = DEPTH_M) -> Track:
    return builders.track(
        id=key,
        state="lost" if detection is None else "confirmed",
        position_m=np.array([x_m, 0.0, 0.0]),
        hits=5,
        age=5,
        detection=detection,
    )


def tracks(number: int, *people: Track) -> Tracks:
    return builders.tracks(*people, stamp_ns=number * PERIOD_NS, sequence=number)


def synchronised(number: int, *people: Track, lockstep: bool = True) -> list[Message]:
    return [frame(number, lockstep), detections(number), tracks(number, *(people or (track(),)))]


def feed(node: GaitNode, messages: Sequence[Message], now_ns: int = 0) -> list[Gait]:
    answers = [answer for message in messages for answer in node.handle(message, now_ns)]
    assert all(isinstance(answer, Gait) for answer in answers)
    return [answer for answer in answers if isinstance(answer, Gait)]


def calibrated(config: GaitConfig | None = None) -> GaitNode:
    node = build(config or GaitConfig())
    feed(node, [INFO])
    return node


def test_frame_with_tracks_gives_points_in_the_map() -> None:
    (gait,) = feed(calibrated(), synchronised(3))
    assert (gait.stamp_ns, gait.sequence, gait.frame_id) == (3 * PERIOD_NS, 3, "map")
    (person,) = gait.people
    points = {point.name: point for point in person.points}
    # Without transforms the camera looks along x from the origin: the person is at x = 2.5 m. The
    # head's middle is at row 26, (26 - 60) / 120 * 2.5 m = -0.71 m from the axis: 0.71 m up. The
    # feet end at row 110: (110 - 60) / 120 * 2.5 m = 1.04 m down.
    assert points["head"].position_m == pytest.approx([DEPTH_M, 0.0, 0.71], abs=0.2)
    feet = [points[name].position_m for name in ("left_foot", "right_foot") if name in points]
    assert feet
    for position in feet:
        assert position[[0, 2]] == pytest.approx([DEPTH_M, -1.04], abs=0.2)
    assert person.measures.steps == 0


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_order_of_arrival_does_not_change_the_points(order: tuple[int, ...]) -> None:
    messages = synchronised(1)
    (gait,) = feed(calibrated(), [messages[k] for k in order])
    (usual,) = feed(calibrated(), messages)
    for ours, theirs in zip(gait.people[0].points, usual.people[0].points, strict=True):
        np.testing.assert_array_equal(ours.position_m, theirs.position_m)


def test_left_and_right_follow_from_the_yaw_of_the_track() -> None:
    # The camera looks along x. If the person has the same heading, left is at +y.
    for yaw_rad, side in ((0.0, 1.0), (math.pi, -1.0)):
        node, found = calibrated(), []
        one = msgspec.structs.replace(track(), yaw_rad=yaw_rad)
        for number in range(8):
            found += feed(node, synchronised(number, one))
        points = {point.name: point for point in found[-1].people[0].points}
        apart_m = points["left_foot"].position_m - points["right_foot"].position_m
        assert side * apart_m[1] > 0.05, yaw_rad


def test_points_are_in_the_frame_of_the_tracks() -> None:
    # The camera is a metre up and looks along y: optical x, y, z are map x, -z, y.
    pose = np.array([[1.0, 0, 0, 5], [0, 0, 1, 0], [0, -1, 0, 1], [0, 0, 0, 1]])
    node = calibrated()
    transform = builders.static_transform(pose, child=OPTICAL)
    (gait,) = feed(node, [transform, *synchronised(1)])
    head = next(point for point in gait.people[0].points if point.name == "head")
    assert head.position_m == pytest.approx([5.0, DEPTH_M, 1.71], abs=0.2)


def test_newest_pending_frame_is_processed_live() -> None:
    """In live mode a slow node must not fall behind."""
    node = calibrated()
    assert not feed(
        node, [*synchronised(1, lockstep=False), *synchronised(2, lockstep=False)], now_ns=0
    )
    assert node.wake_ns() == 3_000_000
    assert not node.tick(2_000_000)
    (gait,) = node.tick(3_000_000)
    assert gait.stamp_ns == 2 * PERIOD_NS
    assert node.status().counters["passed_over"] == 1
    assert node.wake_ns() is None
    assert not node.tick(9_000_000)


def test_every_frame_is_processed_in_lockstep() -> None:
    gait = feed(calibrated(), [message for k in range(4) for message in synchronised(k)])
    assert [one.sequence for one in gait] == [0, 1, 2, 3]


def test_tracks_whose_frame_was_dropped_are_counted() -> None:
    node = calibrated()
    assert not feed(node, synchronised(1)[1:])
    assert not feed(node, synchronised(2)[:1])
    assert len(feed(node, synchronised(3))) == 1
    counters = node.status().counters
    assert (counters["without_frame"], counters["frames_unused"]) == (1, 1)


def test_frames_without_tracks_are_dropped() -> None:
    node = calibrated(GaitConfig(frames=4))
    feed(node, [frame(k) for k in range(10)])
    assert node.status().counters["frames_unused"] == 6
    # frame 5 was evicted, frame 6 is still stored
    assert not feed(node, synchronised(5)[1:])
    assert len(feed(node, synchronised(6)[1:])) == 1


def test_unusable_frames_are_counted() -> None:
    node = build(GaitConfig())
    feed(node, synchronised(1))
    feed(node, [INFO, frame(2, height=60), *synchronised(2)[1:]])
    feed(node, [*synchronised(4), *synchronised(3), *synchronised(4)])
    counters = node.status().counters
    assert counters["no_camera_info"] == counters["wrong_size"] == 1
    assert counters["stale"] == 2


def test_clock_jump_back_resets_the_estimator() -> None:
    node = calibrated()
    assert len(feed(node, [*synchronised(100), *synchronised(1), *synchronised(2)])) == 3
    assert node.status().counters["clock_resets"] == 1


def test_track_without_any_detection_is_not_tracked() -> None:
    lost = track(7, detection=None)
    (gait,) = feed(calibrated(), synchronised(1, track(), lost))
    assert [person.id for person in gait.people] == [1]


def test_undetected_person_is_tracked_by_colour() -> None:
    gait = feed(calibrated(), [m for k in range(5) for m in synchronised(k)])
    node = calibrated()
    feed(node, synchronised(1))
    (undetected,) = feed(node, synchronised(2, track(detection=None)))
    assert gait[-1].people
    (person,) = undetected.people
    assert person.box_xyxy_px == pytest.approx(BOX, abs=12)
    assert any(point.state == "measured" for point in person.points)


def test_nearest_people_of_a_crowd_are_published() -> None:
    crowd = [track(k, None if k > 3 else 0, x_m=float(k)) for k in range(1, 21)]
    node = calibrated(GaitConfig(people_max=2))
    (gait,) = feed(node, synchronised(1, *crowd))
    assert len(gait.people) == 2
    assert node.status().counters["over_budget"] == 1  # of the three detected people


def test_frame_without_people_gives_an_empty_message() -> None:
    (gait,) = feed(calibrated(), [frame(1), detections(1, people=0), tracks(1)])
    assert gait.people == ()


def test_points_move_with_a_moving_camera() -> None:
    mounted = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]])
    node = calibrated()
    feed(node, [builders.static_transform(mounted, parent="base", child=OPTICAL)])
    for k in (0, 1, 2):
        odometry = builders.odometry(
            stamp_ns=k * PERIOD_NS, sequence=k, frame_id="map", child_frame_id="base", x_m=0.1 * k
        )
        feed(node, [odometry])
    gait = feed(node, [*synchronised(0), *synchronised(1), *synchronised(2)])
    heads = [next(p for p in one.people[0].points if p.name == "head") for one in gait]
    # The person keeps their distance from the camera, so they moved by 0.1 m with it.
    moved_m = heads[2].position_m - heads[1].position_m
    assert moved_m[0] == pytest.approx(0.1, abs=0.05)
    assert len(gait) == 3


def test_point_at_rest_before_a_moving_camera_has_no_velocity() -> None:
    # The camera drives along its axis with 0.5 m/s and turns with 0.2 rad/s about y: a point at
    # p = (1, 0, 3) m comes nearer by 0.5 m/s and moves with -omega x p = -(0.6, 0, -0.2) m/s.
    motion = np.zeros((4, 4))
    motion[:3, :3] = 0.2 * np.array([[0, 0, 1], [0, 0, 0], [-1, 0, 0]])
    motion[2, 3] = 0.5
    estimate = PointEstimate(
        position_m=np.array([1.0, 0.0, 3.0]),
        velocity_mps=np.array([-0.6, 0.0, 0.2 - 0.5]),
        covariance=np.eye(6),
        state="measured",
        confidence=1.0,
    )
    gait = to_fixed_frame("head", estimate, np.eye(4), motion)
    assert gait is not None
    assert gait.velocity_mps == pytest.approx([0, 0, 0], abs=1e-12)


def test_never_measured_point_is_not_published() -> None:
    unknown = PointEstimate(np.full(3, np.nan), np.zeros(3), np.eye(6), "lost", 0.0)
    assert to_fixed_frame("head", unknown, np.eye(4), np.zeros((4, 4))) is None


def test_callback_gets_the_published_results() -> None:
    estimate = []
    node = build(GaitConfig(), lambda info, frame, results: estimate.append((info, frame, results)))
    feed(node, [INFO])
    (gait,) = feed(node, synchronised(1))
    ((info, frame, results),) = estimate
    assert info.camera == "front"
    assert frame.stamp_ns == gait.stamp_ns
    assert tuple(one.person for one in results) == gait.people


@pytest.mark.parametrize(
    "fields", [{"people_max": 0}, {"frames": 0}], ids=lambda fields: next(iter(fields))
)
def test_invalid_configuration_is_refused(fields: dict[str, int]) -> None:
    with pytest.raises(ValueError, match=next(iter(fields))):
        msgspec.structs.replace(GaitConfig(), **fields)


def test_warm_up_leaves_nothing_to_compile() -> None:
    """A process that compiles during a frame would seem to hang."""
    warm_up(GaitConfig())
    before = compiled_functions()
    node = calibrated()
    read_only = [decode(encode(m)) for k in range(4) for m in synchronised(k, track(), track(2))]
    assert feed(node, read_only)
    assert compiled_functions() == before
    assert sum(before.values()) > 5


def compiled_functions() -> dict[str, int]:
    """Return the number of compiled argument types of each function."""
    return {
        f"{module}.{name}": len(function.signatures)
        for module, results in tuple(sys.modules.items())
        if module.startswith("services.gait.")
        for name, function in vars(results).items()
        if hasattr(function, "signatures")
    }
