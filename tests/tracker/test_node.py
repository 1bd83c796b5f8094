"""The tracker node: joining, waiting, drops, resets and predictions."""

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from common.geometry.transforms import LINK_FROM_OPTICAL, transform_from
from people4d.messages import Detection, Detections, Embeddings, Message, Odometry, Span, Tracks
from people4d.messages.base import MAX_STAMP_NS
from services.tracker.build import build
from services.tracker.cameras.stamp_guard import SILENT_MAX_NS, SILENT_NS
from services.tracker.node import TrackerNode
from tests import builders
from tests.tracker.scene import published_config

MS = 1_000_000
START_NS = 5_000 * MS  # stamp of frame 0
FRAME_MS = 100
SPAN = Span(stage="detector.inference", process="detector-1@robot", start_ns=1, end_ns=2)
REID = Span(stage="reid.inference", process="reid-1@robot", start_ns=3, end_ns=4)

MAP_FROM_CAMERA = transform_from([10.0, 0.0, 1.0], LINK_FROM_OPTICAL[:3, :3])
TRANSFORM = builders.static_transform(MAP_FROM_CAMERA, child="camera_optical")


def node(**fields: Any) -> TrackerNode:
    config = published_config(**fields)
    return build(config)


def person(x: float = 0.0, forward: float = 3.0) -> Detection:
    left = 320 + 600 * x / forward
    return Detection(
        box_xyxy_px=np.array([left, 100, left + 100, 400], np.float32),
        score=0.9,
        position_m=np.array([x, 0.0, forward]),
    )


def detected(
    number: int, people: Sequence[Detection] = (person(),), camera: str = "front", late_ms: int = 0
) -> Detections:
    return builders.detections(
        *people,
        stamp_ns=START_NS + (number * FRAME_MS + late_ms) * MS,
        sequence=max(number, 0),
        trace=(SPAN,),
        camera=camera,
        frame_id=f"{camera}_optical" if camera != "front" else "camera_optical",
        model="movenet",
    )


def embeddings_of(of: Detections, vectors: Sequence[Sequence[float]] = ((1.0, 0.0),)) -> Embeddings:
    return Embeddings(
        stamp_ns=of.stamp_ns,
        sequence=of.sequence,
        trace=(SPAN, REID),
        camera=of.camera,
        model="histogram",
        detections=tuple(range(len(vectors))),
        vectors=np.array(vectors, np.float32).reshape(-1, len(vectors[0]) if vectors else 2),
    )


def tracks(messages: Iterable[Message]) -> list[Tracks]:
    results = []
    for message in messages:
        assert isinstance(message, Tracks)
        results.append(message)
    return results


def feed(target: TrackerNode, messages: Sequence[Message], now_ns: int = 0) -> list[Tracks]:
    return [t for m in messages for t in tracks(target.handle(m, now_ns))]


def numbers(results: Iterable[Tracks]) -> list[int]:
    return [(t.stamp_ns - START_NS) // (FRAME_MS * MS) for t in results]


def test_a_frame_is_answered_once_its_embeddings_are_there() -> None:
    target = node()
    target.handle(TRANSFORM, 0)
    frame = detected(0)
    assert target.handle(frame, 0) == []
    (results,) = tracks(target.handle(embeddings_of(frame), 10 * MS))
    assert (results.stamp_ns, results.sequence, results.camera) == (frame.stamp_ns, 0, "front")
    assert (results.frame_id, results.tracker) == ("map", "strongsort3d")
    assert results.trace == (SPAN, REID)
    assert target.status().state == "ready"


def test_positions_are_published_in_the_map() -> None:
    # Optical (x right 0.5, y down 0, z forward 3) is link (3, -0.5, 0); the camera stands at
    # (10, 0, 1) in the map: (13, -0.5, 1).
    target = node(publish_tentative=True)
    frame = detected(0, [person(0.5)])
    (results,) = feed(target, [TRANSFORM, frame, embeddings_of(frame)])
    np.testing.assert_allclose(results.tracks[0].position_m, [13.0, -0.5, 1.0])


@pytest.mark.slow
def test_any_order_of_arrival_gives_the_same_tracks() -> None:
    frames = [detected(k, [person(-0.5 + 0.02 * k), person(0.5 - 0.02 * k)]) for k in range(3)]
    messages: list[Message] = [*frames, *(embeddings_of(f, [[1, 0], [0, 1]]) for f in frames)]

    def run(order: Sequence[Message]) -> list[Any]:
        target = node(publish_tentative=True)
        return [
            msgspec.to_builtins(t, enc_hook=np.ndarray.tolist)
            for t in feed(target, [TRANSFORM, *order])
        ]

    expected = run([m for pair in zip(frames, messages[3:], strict=True) for m in pair])
    assert len(expected) == 3
    in_camera_order = [
        order
        for order in itertools.permutations(messages)
        if [m for m in order if isinstance(m, Detections)] == frames
    ]
    assert len(in_camera_order) == 120
    for order in in_camera_order[::3]:
        assert run(order) == expected


def test_an_empty_frame_waits_for_nothing() -> None:
    (results,) = feed(node(), [TRANSFORM, detected(0, [])])
    assert results.tracks == ()


def test_a_frame_without_crops_waits_for_nothing() -> None:
    frame = replace(detected(0), crops=0)
    target = node()
    target.handle(TRANSFORM, 0)
    assert len(tracks(target.handle(frame, 1000 * MS))) == 1
    target.handle(embeddings_of(frame, ()), 1001 * MS)
    counters = target.status().counters
    assert (counters["without_embeddings"], counters["late_embeddings"]) == (0, 0)
    assert target.handle(replace(detected(1), crops=1), 1100 * MS) == []


def test_sort3d_waits_for_no_embeddings() -> None:
    (results,) = feed(node(tracker="sort3d"), [TRANSFORM, detected(0)])
    assert results.trace == (SPAN,)


def test_frame_without_embeddings_continues_after_a_timeout() -> None:
    target = node()
    target.handle(TRANSFORM, 0)
    assert target.handle(detected(0), 1000 * MS) == []
    assert target.wake_ns() == 1050 * MS
    assert target.tick(1049 * MS) == []
    (results,) = tracks(target.tick(1050 * MS))
    assert results.trace == (SPAN,)
    assert target.status().counters["embedding_timeouts"] == 1


def test_a_dead_reid_delays_only_the_first_frames() -> None:
    target = node()
    target.handle(TRANSFORM, 0)
    now = 0
    for number in range(3):
        assert target.handle(detected(number), now) == []
        now += 100 * MS
        assert len(target.tick(now)) == 1
    assert len(target.handle(detected(3), now)) == 1  # no more waiting
    status = target.status()
    assert (status.state, status.reason) == (
        "degraded",
        "no embeddings arrive: tracks are matched by motion alone",
    )
    assert status.counters["embedding_timeouts"] == 3
    assert status.counters["without_embeddings"] == 4
    # One late embedding arrives, and frames wait again.
    assert target.handle(embeddings_of(detected(3)), now) == []
    assert target.status().counters["late_embeddings"] == 1
    assert target.handle(detected(4), now + 100 * MS) == []
    assert target.status().state == "ready"


def test_frames_are_tracked_by_stamp_while_they_wait() -> None:
    target = node()
    target.handle(TRANSFORM, 0)
    first, second = detected(0), detected(1)
    assert feed(target, [second, first, embeddings_of(second)]) == []  # the older one still waits
    assert numbers(feed(target, [embeddings_of(first)])) == [0, 1]


def test_a_stale_frame_is_dropped_and_counted() -> None:
    target = node(tracker="sort3d")
    results = feed(
        target, [TRANSFORM, detected(0), detected(2), detected(1), detected(2), detected(3)]
    )
    assert numbers(results) == [0, 2, 3]
    counters = target.status().counters
    assert (counters["stale"], counters["duplicates"], counters["missing"]) == (1, 1, 1)


def test_loop_of_transforms_is_reported_and_changes_no_pose() -> None:
    target = node(embedding_wait_s=0.0)
    before = feed(target, [TRANSFORM, *(detected(k) for k in range(10))])
    for parent, child, x_m in (("hall", "stand", 1.0), ("stand", "hall", 2.0)):
        matrix = transform_from([x_m, 0.0, 0.0], np.eye(3))
        target.handle(builders.static_transform(matrix, parent=parent, child=child), 0)
    after = feed(target, [detected(k) for k in range(10, 20)])
    reason = "transforms form a loop: hall <- stand <- hall: the shortest chain is used"
    assert reason in target.status().reason
    assert after[-1].tracks[0].id == before[-1].tracks[0].id
    assert target.status().counters["transform_changes"] == 0


def test_looped_recording_gives_new_identities() -> None:
    target = node(tracker="sort3d")
    loop = [detected(k) for k in range(30)]
    first = feed(target, [TRANSFORM, *loop])
    assert feed(target, loop[:10]) == []  # held: may be another publisher
    second = tracks(target.tick(SILENT_NS)) + feed(target, loop[10:], SILENT_NS)
    assert numbers(second) == list(range(30))
    assert {p.id for t in first for p in t.tracks} == {1}
    assert {p.id for t in second for p in t.tracks} == {2}
    counters = target.status().counters
    assert (counters["clock_resets"], counters["stale"]) == (1, 0)


def test_frames_that_wait_when_the_clock_jumps_are_not_lost() -> None:
    target = node()
    target.handle(TRANSFORM, 0)
    assert feed(target, [detected(50)]) == []
    assert feed(target, [detected(0)]) == []
    assert numbers(tracks(target.tick(SILENT_NS))) == [50, 0]


def test_detections_that_cannot_be_used_are_counted() -> None:
    nowhere = msgspec.structs.replace(person(), position_m=None)
    far = msgspec.structs.replace(person(), position_m=np.array([0.0, 0.0, 9e6]))
    flat = msgspec.structs.replace(person(), box_xyxy_px=np.array([5, 5, 5, 90], np.float32))
    target = node(tracker="sort3d", publish_tentative=True)
    (results,) = feed(target, [TRANSFORM, detected(0, [nowhere, far, flat, person()])])
    assert [p.detection for p in results.tracks] == [3]
    counters = target.status().counters
    assert [counters[n] for n in ("without_position", "out_of_range", "empty_boxes")] == [1, 1, 1]


def test_embeddings_that_fit_no_detection_are_counted() -> None:
    frame = detected(0)
    target = node(publish_tentative=True)
    odd = msgspec.structs.replace(
        embeddings_of(frame, [[3.0, 4.0], [1.0, 0.0], [0.0, 0.0]]), detections=(0, 7, 0)
    )
    (results,) = feed(target, [TRANSFORM, frame, odd])
    assert len(results.tracks) == 1
    assert target.status().counters["bad_embeddings"] == 2


def test_without_transform_the_camera_stands_at_the_origin() -> None:
    target = node(tracker="sort3d", publish_tentative=True)
    (results,) = feed(target, [detected(0, [person(0.5)])])
    np.testing.assert_allclose(results.tracks[0].position_m, [3.0, -0.5, 0.0])
    status = target.status()
    assert status.state == "degraded"
    assert status.reason.startswith("no transform map <- camera_optical")
    # The transform moves people by 10 m: tracks restart.
    (results,) = feed(target, [TRANSFORM, detected(1, [person(0.5)])])
    assert [p.id for p in results.tracks] == [2]
    np.testing.assert_allclose(results.tracks[0].position_m, [13.0, -0.5, 1.0])
    assert target.status().state == "ready"
    assert target.status().counters["transform_changes"] == 1


def test_the_same_transform_again_changes_nothing() -> None:
    target = node(tracker="sort3d", publish_tentative=True)
    results = feed(target, [TRANSFORM, detected(0), TRANSFORM, detected(1)])
    assert [p.id for t in results for p in t.tracks] == [1, 1]


def test_frames_without_a_required_transform_are_dropped() -> None:
    target = node(tracker="sort3d", require_transform=True)
    elsewhere = msgspec.structs.replace(TRANSFORM, parent="odom")
    assert feed(target, [elsewhere, detected(0)]) == []
    status = target.status()
    assert (status.state, status.counters["no_transform"]) == ("degraded", 1)
    assert numbers(feed(target, [TRANSFORM, detected(1)])) == [1]


def test_published_states() -> None:
    for lost, tentative in itertools.product([False, True], repeat=2):
        target = node(tracker="sort3d", publish_lost=lost, publish_tentative=tentative)
        results = feed(target, [TRANSFORM, detected(0), detected(1), detected(2), detected(3, [])])
        assert [len(t.tracks) for t in results] == [tentative, tentative, 1, lost]


def walk(target: TrackerNode, frames: int = 10, start: int = 0) -> list[Tracks]:
    """Feed a frame every 100 ms of a person walking to the right at 0.5 m/s."""
    results = []
    for number in range(start, start + frames):
        now_ns = number * FRAME_MS * MS
        results += tracks(target.handle(detected(number, [person(0.05 * number)]), now_ns))
        results += tracks(target.tick(now_ns))
    return results


def test_predictions_go_on_for_half_a_second_while_no_detections_come() -> None:
    target = node(tracker="sort3d")
    target.handle(TRANSFORM, 0)
    walk(target)  # the last frame arrived at 900 ms; frames arrive every 100 ms
    assert target.wake_ns() == 1200 * MS  # 3 usual intervals are longer than 0.2 s
    assert target.tick(1199 * MS) == []
    results = list[Tracks]()
    while (wake_ns := target.wake_ns()) is not None:
        results += tracks(target.tick(wake_ns))
    # The last frame's stamp is 900 ms: 0.5 s after it people are unknown.
    stamps_ms = [(t.stamp_ns - START_NS) // MS for t in results]
    assert stamps_ms == [1200, 1300, 1400, 1500]
    assert all(t.predicted for t in results)
    people = [t.tracks[0] for t in results[:-1]]
    assert {(p.id, p.state, p.detection) for p in people} == {(1, "lost", None)}
    steps = np.diff([p.position_m[1] for p in people])
    np.testing.assert_allclose(steps, people[0].velocity_mps[1] * 0.1, atol=1e-9)
    assert np.all(np.diff([p.covariance[0, 0] for p in people]) > 0)
    assert results[-1].tracks == ()  # one empty message: people are unknown
    assert target.status().counters["people_unknown"] == 1


def test_track_that_ends_while_no_detections_come_is_not_counted() -> None:
    target = node(tracker="sort3d", max_lost_s=0.35)
    target.handle(TRANSFORM, 0)
    walk(target)
    results = list[Tracks]()
    while (wake_ns := target.wake_ns()) is not None:
        results += tracks(target.tick(wake_ns))
    assert [len(t.tracks) for t in results] == [1, 0]
    assert target.status().counters["people_unknown"] == 0


def test_predictions_end_where_stamps_end() -> None:
    target = node(tracker="sort3d")
    late_ns = MAX_STAMP_NS - START_NS - 1200 * MS  # of the first frame behind `START_NS`
    target.handle(TRANSFORM, 0)
    for number in range(10):
        frame = detected(number, [person(0.05 * number)])
        frame = replace(frame, stamp_ns=frame.stamp_ns + late_ns)
        target.handle(frame, number * FRAME_MS * MS)
    stamps = list[int]()
    while (wake_ns := target.wake_ns()) is not None:
        stamps += [t.stamp_ns for t in tracks(target.tick(wake_ns))]
    assert stamps == [MAX_STAMP_NS]


def test_predictions_change_nothing_for_the_frames_that_follow() -> None:
    quiet, asked = node(tracker="sort3d"), node(tracker="sort3d")
    for target in (quiet, asked):
        target.handle(TRANSFORM, 0)
        walk(target)
    assert len(asked.tick(1200 * MS)) == 1
    assert len(asked.tick(1400 * MS)) == 1
    expected, results = walk(quiet, start=30), walk(asked, start=30)
    assert [msgspec.to_builtins(t, enc_hook=np.ndarray.tolist) for t in results] == [
        msgspec.to_builtins(t, enc_hook=np.ndarray.tolist) for t in expected
    ]


def test_slow_playback_is_no_outage() -> None:
    # Lock-step on a slow machine: a frame every second, recorded 100 ms apart.
    target = node(tracker="sort3d")
    target.handle(TRANSFORM, 0)
    results = []
    for number in range(10):
        results += tracks(target.handle(detected(number), number * 1000 * MS))
        results += tracks(target.tick(number * 1000 * MS + 900 * MS)) if number > 1 else []
    assert numbers(results) == list(range(10))


def test_a_frame_does_not_wait_for_another_camera() -> None:
    target = node(tracker="sort3d")
    back = msgspec.structs.replace(TRANSFORM, child="back_optical")
    feed(target, [TRANSFORM, back, detected(0, [])])
    frames = [detected(0, [], "back", late_ms=50), detected(1, [], "back", late_ms=50)]
    assert [len(tracks(target.handle(f, 10 * MS))) for f in (*frames, detected(1, []))] == [1] * 3
    assert target.status().counters["late_frames"] == 1


def test_two_cameras_are_tracked_in_one_order_of_stamps_if_a_wait_is_set() -> None:
    target = node(tracker="sort3d", reorder_wait_s=0.1)
    back = msgspec.structs.replace(TRANSFORM, child="back_optical")
    assert len(feed(target, [TRANSFORM, back, detected(0, [])])) == 1
    # The back camera's frames (50 and 150 ms) arrive before the front camera's frame (100 ms).
    assert target.handle(detected(0, [], "back", late_ms=50), 10 * MS) == []
    assert target.handle(detected(1, [], "back", late_ms=50), 20 * MS) == []
    results = tracks(target.handle(detected(1, []), 30 * MS))
    assert [(t.camera, t.stamp_ns - START_NS) for t in results] == [
        ("back", 50 * MS),
        ("front", 100 * MS),
    ]
    # The frame of 150 ms came at 20 ms and waits for the front camera at most 100 ms.
    assert target.wake_ns() == 120 * MS
    assert numbers(tracks(target.tick(120 * MS))) == [1]
    assert target.status().counters["stale"] == 0


@pytest.mark.parametrize("name", ["sort3d", "strongsort3d"])
def test_lockstep_loses_no_frame(name: str) -> None:
    target = node(tracker=name, embedding_wait_s=60.0)
    messages: list[Message] = [TRANSFORM]
    for number in range(50):
        frame = detected(number, [person()] * (number % 3 != 0))
        messages += [frame, embeddings_of(frame, [[1.0, 0.0]] * len(frame.detections))]
    assert numbers(feed(target, messages)) == list(range(50))


@pytest.mark.parametrize("name", ["sort3d", "strongsort3d"])
def test_wild_input_is_answered_or_counted(name: str) -> None:
    # Huge numbers, missing positions, jumping clocks, two cameras, embeddings of other frames.
    rng = np.random.default_rng(5)
    target, now_ns, sent, answers = node(tracker=name), 0, 0, list[Tracks]()
    for number in range(600):
        now_ns += int(rng.integers(0, 60 * MS))
        wild = [_wild_person(rng) for _ in range(rng.integers(0, 4))]
        frame = detected(number, wild, camera="front" if rng.random() < 0.9 else "back")
        if rng.random() < 0.05:
            frame = msgspec.structs.replace(frame, stamp_ns=int(rng.integers(-(2**62), 2**62)))
        vectors = rng.normal(size=(int(rng.integers(0, 4)), int(rng.integers(2, 4)))) * 1e2
        embeddings = msgspec.structs.replace(
            embeddings_of(frame, vectors.tolist()),
            detections=tuple(rng.integers(0, 5, len(vectors))),
        )
        answers += feed(target, [frame, embeddings], now_ns) + tracks(target.tick(now_ns))
        sent += 1
    answers += tracks(target.tick(now_ns + SILENT_MAX_NS))
    counters = target.status().counters
    answered = sum(not t.predicted for t in answers)
    assert answered + counters["stale"] + counters["stray_frames"] == sent
    assert counters["clock_resets"] > 0
    assert counters["out_of_range"] > 0


def _wild_person(rng: np.random.Generator) -> Detection:
    corner = rng.uniform(-1, 1, 2) * 10.0 ** rng.choice([2, 2, 5])
    box = np.concatenate([corner, corner + rng.uniform(-10, 200, 2)])
    position = rng.normal(size=3) * 10.0 ** rng.choice([0, 0, 6])
    return Detection(
        box_xyxy_px=box.astype(np.float32),
        score=float(rng.choice([0.0, 0.5, 1.0])),
        position_m=position if rng.random() < 0.8 else None,
    )


MOUNT = builders.static_transform(LINK_FROM_OPTICAL, parent="base_link", child="camera_optical")


def driven(number: float, x_m: float) -> Odometry:
    return builders.odometry(stamp_ns=START_NS + int(number * FRAME_MS) * MS, x_m=x_m)


def test_standing_person_has_no_velocity_before_a_driving_robot() -> None:
    # 1 m/s towards a standing person at (5, 0): 0.1 m nearer in each frame.
    target = node(tracker="sort3d", frame_id="odom", publish_tentative=True)
    results = feed(target, [MOUNT, driven(0, 0.0)])
    for k in range(10):
        frame = detected(k, [person(0.0, 5.0 - 0.1 * k)])
        results += feed(target, [driven(k + 1, 0.1 * (k + 1)), frame])
    assert len(results) == 10
    for tracks_ in results:
        np.testing.assert_allclose(tracks_.tracks[0].position_m[:2], [5.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(tracks_.tracks[0].velocity_mps[:2], [0.0, 0.0], atol=1e-9)
    assert target.status().state == "ready"


def test_frame_waits_for_its_odometry_until_a_timeout() -> None:
    target = node(tracker="sort3d", frame_id="odom")
    assert numbers(feed(target, [MOUNT, driven(0, 0.0), detected(0)])) == [0]
    assert feed(target, [detected(1)], 0) == []
    assert target.wake_ns() == 50 * MS
    assert numbers(tracks(target.handle(driven(1.5, 0.1), 20 * MS))) == [1]
    assert feed(target, [detected(2)], 100 * MS) == []
    assert numbers(tracks(target.tick(149 * MS))) == []
    assert numbers(tracks(target.tick(150 * MS))) == [2]
    assert target.status().counters["predicted_base"] == 1


def test_frames_keep_their_order_while_they_wait_for_odometry() -> None:
    target = node(tracker="sort3d", frame_id="odom")
    assert numbers(feed(target, [MOUNT, driven(0, 0.0), detected(0)])) == [0]
    assert feed(target, [detected(1), detected(2)]) == []
    assert numbers(feed(target, [driven(1, 0.0)])) == [1]
    assert numbers(feed(target, [driven(2, 0.0)])) == [2]


def test_a_clock_that_goes_back_while_a_frame_waits_loses_nothing() -> None:
    target = node(tracker="sort3d", frame_id="odom")
    feed(target, [MOUNT, driven(30, 0.0)])
    assert feed(target, [detected(31)]) == []
    again = [detected(k) for k in range(5)]
    assert feed(target, again, 1) == []
    assert numbers(tracks(target.tick(SILENT_NS + 1))) == [31, *range(5)]
