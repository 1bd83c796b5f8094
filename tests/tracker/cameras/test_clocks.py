"""Cameras with different clocks, and clocks with coarse or jittering stamps."""

import itertools
from collections.abc import Iterable, Sequence

import msgspec
import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL
from people4d.messages import Detections, Mask, Span, StaticTransform, Tracks
from people4d.messages.base import MAX_CAMERAS
from services.tracker.cameras.stamp_guard import HELD_MAX, HELD_MAX_BYTES, PERSON_BYTES, SILENT_NS
from services.tracker.node import TrackerNode
from tests import builders
from tests.tracker.test_node import MS, detected, embeddings_of, node, person, tracks

PERIOD_MS = 66
DELAY_MS = 80  # from acquisition to arrival
SPEED_MPS = 1.0
FRAMES = 150
HOUR_MS = 3_600_000
MOUNTS = [builders.static_transform(LINK_FROM_OPTICAL, child="camera_optical")] + [
    builders.static_transform(LINK_FROM_OPTICAL, child=f"{name}_optical")
    for name in ("back", "left")
]


def view_of(number: int, camera: str, ahead_ms: float = 0.0, phase_ms: float = 0.0) -> Detections:
    """Frame of a camera whose clock is ahead; a person walks to the right."""
    true_ms = number * PERIOD_MS + phase_ms
    people = [person(-2.0 + SPEED_MPS * true_ms / 1000 % 4.0)]
    frame = detected(0, people, camera)
    stamp_ns = frame.stamp_ns + int((true_ms + ahead_ms) * MS)
    return msgspec.structs.replace(frame, stamp_ns=stamp_ns, sequence=number)


def arrivals(
    camera: str, ahead_ms: float = 0.0, phase_ms: float = 0.0
) -> list[tuple[float, Detections]]:
    """Frames of a camera with their times of arrival [ms]."""
    return [
        (number * PERIOD_MS + phase_ms + DELAY_MS, view_of(number, camera, ahead_ms, phase_ms))
        for number in range(FRAMES)
    ]


def play(
    target: TrackerNode,
    *streams: Sequence[tuple[float, Detections]],
    mounts: Iterable[StaticTransform] = MOUNTS,
) -> list[Tracks]:
    """Feed frames in the order of their arrival, with ticks at the wake times of the node."""
    results = [t for mount in mounts for t in tracks(target.handle(mount, 0))]
    for at_ms, frame in sorted(itertools.chain(*streams), key=lambda item: item[0]):
        now_ns = int(at_ms * MS)
        while (wake_ns := target.wake_ns()) is not None and wake_ns < now_ns:
            results += tracks(target.tick(wake_ns))
        results += tracks(target.handle(frame, now_ns))
    return results + tracks(target.flush(int((FRAMES + 1) * PERIOD_MS * MS)))


def answered(results: Iterable[Tracks], camera: str) -> list[Tracks]:
    """Answers to frames of a camera, without predictions."""
    return [t for t in results if t.camera == camera and t.trace]


@pytest.mark.parametrize("ahead_ms", [-500.0, 500.0, HOUR_MS, -HOUR_MS])
def test_frames_of_a_camera_with_another_clock_are_tracked_at_their_corrected_times(
    ahead_ms: float,
) -> None:
    target = node(tracker="sort3d")
    results = play(target, arrivals("front"), arrivals("back", ahead_ms, phase_ms=30.0))
    assert len(answered(results, "front")) >= FRAMES - 1
    assert len(answered(results, "back")) >= FRAMES - 5
    assert target.status().state == "ready"
    assert target.status().gauges["camera_offset_back_ms"] == pytest.approx(ahead_ms, abs=2.0)
    assert target.status().gauges["camera_offset_front_ms"] == 0.0


def test_person_in_view_of_two_cameras_keeps_one_identity_and_velocity() -> None:
    target = node(tracker="sort3d")
    results = play(target, arrivals("front")[:28], arrivals("back", -500.0, phase_ms=30.0)[:28])
    people = [person for t in results[20:] for person in t.tracks]
    assert {person.id for person in people} == {1}
    # With uncorrected stamps positions would jump by 0.5 m between frames.
    speeds = [-person.velocity_mps[1] for person in people]
    np.testing.assert_allclose(speeds, SPEED_MPS, atol=0.1)


def test_one_message_of_a_camera_an_hour_ahead_does_not_silence_the_others() -> None:
    target = node(tracker="sort3d")
    stray = (1000.0, view_of(0, "left", HOUR_MS))
    results = play(target, arrivals("front"), [stray])
    assert len(answered(results, "front")) == FRAMES
    assert target.status().counters["stale"] == 0
    assert target.status().counters["clock_resets"] == 0


def test_a_longer_delay_that_the_trace_explains_is_no_other_clock() -> None:
    target = node(tracker="sort3d")
    slow = [
        (at_ms + 300.0, msgspec.structs.replace(frame, trace=(frame.trace[0], inference(300))))
        for at_ms, frame in arrivals("back", phase_ms=30.0)
    ]
    play(target, arrivals("front"), slow)
    assert target.status().gauges["camera_offset_back_ms"] == pytest.approx(0.0, abs=2.0)


def inference(duration_ms: int) -> Span:
    return Span(
        stage="detector.inference", process="detector-2@host", start_ns=0, end_ns=duration_ms * MS
    )


def test_a_clock_set_back_during_the_run_is_measured_again() -> None:
    target = node(tracker="sort3d")
    back = arrivals("back", phase_ms=30.0)[:50] + arrivals("back", -700.0, phase_ms=30.0)[50:]
    results = play(target, arrivals("front"), back)
    assert len(answered(results, "front")) >= FRAMES - 1
    assert len(answered(results, "back")) >= FRAMES - 12
    assert target.status().gauges["camera_offset_back_ms"] == pytest.approx(-700.0, abs=2.0)


def test_other_cameras_continue_after_the_reference_ended() -> None:
    target = node(tracker="sort3d")
    results = play(target, arrivals("front")[:40], arrivals("back", -500.0, phase_ms=30.0))
    assert len(answered(results, "back")) >= FRAMES - 5


def test_a_restarted_tracker_continues_with_the_offsets() -> None:
    before, after = node(tracker="sort3d"), node(tracker="sort3d")
    front, back = arrivals("front"), arrivals("back", -500.0, phase_ms=30.0)
    play(before, front[:50], back[:50])
    after.restore(before.save(), before.next_number())
    # The camera that is not the reference is first.
    results = play(after, front[60:], back[55:], mounts=())
    assert after.status().counters["clock_resets"] == 0
    assert len(answered(results, "front")) == len(front[60:])
    assert len(answered(results, "back")) >= len(back[55:]) - 2


def test_invented_cameras_are_refused_and_the_known_ones_go_on() -> None:
    target = node(tracker="sort3d")
    invented = [
        (
            1000.0 + number * 0.1,
            msgspec.structs.replace(view_of(0, "left", number), camera=f"c{number}"),
        )
        for number in range(300)
    ]
    results = play(target, arrivals("front"), invented)
    assert len(answered(results, "front")) == FRAMES
    assert target.status().counters["refused_cameras"] >= 300 - MAX_CAMERAS
    assert len(target.status().gauges) <= MAX_CAMERAS


@pytest.mark.parametrize("stamps", ["equal", "jittering"])
def test_no_frame_is_lost_for_its_stamp(stamps: str) -> None:
    chance = np.random.default_rng(0)
    frames = []
    for at_ms, frame in arrivals("front"):
        shift_ms = chance.uniform(-100, 100)
        if stamps == "equal":  # two frames share each stamp
            shift_ms = -PERIOD_MS * (frame.sequence % 2)
        stamp_ns = frame.stamp_ns + int(shift_ms * MS)
        frames.append((at_ms, msgspec.structs.replace(frame, stamp_ns=stamp_ns)))
    target = node(tracker="sort3d")
    results = answered(play(target, frames), "front")
    assert [t.stamp_ns for t in results] == [frame.stamp_ns for _, frame in frames]
    assert [t.sequence for t in results] == list(range(FRAMES))
    counters = target.status().counters
    assert (counters["stale"], counters["duplicates"], counters["clock_resets"]) == (0, 0, 0)


@pytest.mark.parametrize("ahead_ms", [HOUR_MS, 5000.0, -5000.0, -HOUR_MS])
def test_messages_in_the_name_of_a_camera_with_a_far_stamp_are_left_out(ahead_ms: float) -> None:
    target = node(tracker="sort3d")
    forged = [(1000.0 + k, view_of(15 + k, "front", ahead_ms)) for k in range(30)]
    forged.append((3000.0, view_of(45, "front", -ahead_ms)))
    results = play(target, arrivals("front"), forged)
    assert [t.sequence for t in answered(results, "front")] == list(range(FRAMES))
    assert {person.id for t in results[5:50] for person in t.tracks} == {1}
    status = target.status()
    assert (status.counters["stray_frames"], status.counters["clock_resets"]) == (31, 0)
    assert status.state == "degraded"
    last = "behind" if ahead_ms > 0 else "ahead of"
    assert f" s {last} its clock are dropped: does another publisher use" in status.reason


def test_messages_between_the_rare_frames_of_a_camera_are_left_out() -> None:
    target = node(tracker="sort3d")
    forged = [(1500.0 + k, view_of(15 + k, "front", HOUR_MS)) for k in range(5)]
    results = play(target, arrivals("front")[::20], forged)  # a frame in 1.3 s
    assert [t.sequence for t in answered(results, "front")] == list(range(0, FRAMES, 20))
    assert target.status().counters["clock_resets"] == 0


def test_an_old_message_that_is_sent_again_and_again_is_left_out() -> None:
    target = node(tracker="sort3d")
    old = [(5000.0 + k, view_of(10, "front")) for k in range(50)]
    results = play(target, arrivals("front"), old)
    assert [t.sequence for t in answered(results, "front")] == list(range(FRAMES))
    counters = target.status().counters
    assert (counters["stray_frames"], counters["clock_resets"]) == (50, 0)


@pytest.mark.parametrize("ahead_ms", [5000.0, -5000.0])
def test_a_clock_that_is_set_is_followed_after_a_second_and_no_frame_is_lost(
    ahead_ms: float,
) -> None:
    target = node(tracker="sort3d")
    frames = arrivals("front")[:50] + [
        (at_ms, view_of(50 + k, "front", ahead_ms))
        for k, (at_ms, _) in enumerate(arrivals("front")[50:])
    ]
    results = answered(play(target, frames), "front")
    assert [t.sequence for t in results] == list(range(FRAMES))
    assert target.status().counters["stray_frames"] == 0
    assert target.status().counters["clock_resets"] == (ahead_ms < 0)
    assert target.status().state == "ready"


def test_frames_that_waited_for_a_set_clock_have_their_embeddings() -> None:
    target = node()
    target.handle(MOUNTS[0], 0)
    frames = arrivals("front", -20000.0)[:11]
    for at_ms, frame in frames:
        sent = arrivals("front")[0][1] if frame.sequence == 0 else frame
        for message in (sent, embeddings_of(sent)):
            target.handle(message, int(at_ms * MS))
    results = tracks(target.tick(int(frames[1][0] * MS) + SILENT_NS))
    assert [t.sequence for t in results] == list(range(1, 11))
    counters = target.status().counters
    assert counters["clock_resets"] == 1
    assert (counters["without_embeddings"], counters["late_embeddings"]) == (0, 0)


def test_of_frames_that_wait_for_a_set_clock_the_last_ones_and_the_first_are_held() -> None:
    target = node(tracker="sort3d")
    target.handle(MOUNTS[0], 0)
    target.handle(view_of(100, "front"), 0)
    for k in range(HELD_MAX + 5):
        target.handle(view_of(k, "front"), k)
    assert target.status().counters["stray_frames"] == 5
    results = tracks(target.tick(SILENT_NS))
    assert [t.sequence for t in results] == [0, *range(6, HELD_MAX + 5)]


def test_frames_that_wait_for_a_set_clock_are_bounded_in_bytes() -> None:
    target = node(tracker="sort3d")
    target.handle(MOUNTS[0], 0)
    target.handle(view_of(100, "front"), 0)
    mask = Mask.from_array(np.ones((2000, 4000), np.uint8))  # 1 MB
    for k in range(30):
        (shown,) = view_of(k, "front").detections
        frame = msgspec.structs.replace(
            view_of(k, "front"), detections=(msgspec.structs.replace(shown, mask=mask),)
        )
        target.handle(frame, k)
    assert len(tracks(target.tick(SILENT_NS))) == HELD_MAX_BYTES // (10**6 + 2 * PERSON_BYTES)


def test_a_camera_in_lockstep_that_waits_for_an_answer_gets_it_after_a_second() -> None:
    target = node(tracker="sort3d")
    before = arrivals("front")[50:80]
    loop_ms = before[-1][0] + PERIOD_MS
    results = play(target, before, [(loop_ms, view_of(80, "front", -5280.0))])
    assert answered(results, "front")[-1].sequence == 80


def test_frames_of_a_stopped_camera_that_comes_back_are_tracked_at_once() -> None:
    target = node(tracker="sort3d")
    play(target, arrivals("front")[:30])
    late = arrivals("front")[120]
    results = target.handle(late[1], int(late[0] * MS))
    assert [t.sequence for t in tracks(results)] == [120]
