"""Late frames, and clocks and delays that people in view of two cameras separate."""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from people4d.messages import F64, Detections, Tracks
from services.tracker.build import build, make_tracker
from services.tracker.config import TrackerConfig
from services.tracker.node import TrackerNode
from tests.tracker.cameras.test_clocks import MOUNTS, play
from tests.tracker.scene import frame as frame_of
from tests.tracker.scene import person as measured
from tests.tracker.test_node import MS, START_NS, detected, person

PERIOD_MS = 132
DELAY_MS = 80
FRAMES = 200


def path_m(t_s: float) -> tuple[float, float]:
    """Position of a walking person: right of the cameras, and ahead of them [m]."""
    return 1.5 * math.sin(0.7 * t_s), 3.5 + 0.8 * math.sin(0.45 * t_s)


def stream(
    camera: str,
    late_ms: float | Sequence[float] = 0.0,
    ahead_ms: float = 0.0,
    phase_ms: float = 0,
    frames: int = FRAMES,
) -> list[tuple[float, Detections]]:
    """Frames of a camera with their times of arrival [ms], in order."""
    rng = np.random.default_rng(len(camera))
    arrivals, last_ms = [], 0.0
    for number in range(frames):
        true_ms = number * PERIOD_MS + phase_ms
        x, forward = path_m(true_ms / 1000) + rng.normal(0, 0.03, 2)
        frame = detected(0, [person(x, forward)], camera)
        stamp_ns = START_NS + int((true_ms + ahead_ms) * MS)
        delay_ms = late_ms if isinstance(late_ms, float | int) else late_ms[number % len(late_ms)]
        last_ms = max(last_ms, true_ms + DELAY_MS + delay_ms)
        arrivals.append((last_ms, replace(frame, stamp_ns=stamp_ns, sequence=number)))
    return arrivals


def tracker_node(**fields: Any) -> TrackerNode:
    return build(TrackerConfig(embedding_wait_s=0.0, **fields))


def errors_m(results: Sequence[Tracks], camera: str, ahead_ms: float = 0.0) -> F64:
    """Errors of the answers to a camera's frames at their own times, after 16 s."""
    errors = []
    for answer in results:
        t_s = (answer.stamp_ns - START_NS - ahead_ms * MS) / 1e9
        if answer.camera != camera or not answer.trace or t_s < 16:
            continue
        (track,) = answer.tracks
        x, forward = path_m(t_s)
        errors.append(np.hypot(track.position_m[0] - forward, track.position_m[1] + x))
    return np.array(errors)


def rms(errors: F64) -> float:
    return float(np.sqrt((errors**2).mean()))


@cache
def rms_in_time_m() -> tuple[float, float]:
    """Errors without late frames: of the first camera alone, and of the second with the first."""
    alone = play(tracker_node(), stream("front"))
    both = play(tracker_node(), stream("front"), stream("back", phase_ms=30))
    return rms(errors_m(alone, "front")), rms(errors_m(both, "back"))


def test_a_late_frame_gives_the_tracks_that_it_gives_in_time() -> None:
    in_time, late = (make_tracker(TrackerConfig()) for _ in range(2))
    frames = [
        frame_of(k, measured(3.0 + 0.1 * k, 0.02 * k**2), camera="ab"[k % 2]) for k in range(12)
    ]
    for frame in frames:
        expected = in_time.update(frame)
    for frame in (*frames[:8], *frames[9:11]):
        late.update(frame)
    (then,) = late.update(frames[8])
    np.testing.assert_allclose(then.position_m[:2], [3.8, 0.02 * 64], atol=0.1)
    found = late.update(frames[11])
    np.testing.assert_allclose(found[0].position_m, expected[0].position_m, atol=1e-9)
    np.testing.assert_allclose(found[0].velocity_mps, expected[0].velocity_mps, atol=1e-9)
    np.testing.assert_allclose(found[0].covariance, expected[0].covariance, atol=1e-9)
    assert (found[0].id, found[0].hits) == (expected[0].id, expected[0].hits)


def test_a_late_frame_without_people_changes_no_state() -> None:
    tracker = make_tracker(TrackerConfig())
    for k in range(10):
        tracker.update(frame_of(k, measured(3.0 + 0.1 * k, 0.0), camera="a"))
    (before,) = tracker.predict(frame_of(10).stamp_ns)
    tracker.update(frame_of(7, camera="b"))
    (after,) = tracker.predict(frame_of(10).stamp_ns)
    np.testing.assert_array_equal(after.position_m, before.position_m)
    np.testing.assert_array_equal(after.covariance, before.covariance)


def test_person_in_late_frames_only_is_tracked_at_the_present() -> None:
    tracker = make_tracker(TrackerConfig())
    for k in range(10):
        tracker.update(frame_of(k, measured(3.0, 0.0), camera="a"))
        if k >= 3:
            tracker.update(frame_of(k - 3, measured(4.0, 2.0 + 0.1 * k), camera="b"))
    people = {t.id: t for t in tracker.predict(frame_of(9).stamp_ns)}
    assert set(people) == {1, 2}
    assert people[2].time_since_update_s == pytest.approx(0.3)
    # Last seen at 2.9 m, 0.3 s earlier, at 1 m/s.
    assert people[2].position_m[1] == pytest.approx(3.2, abs=0.1)


@pytest.mark.parametrize(
    ("late_ms", "others"),  # limit of the error of the other camera, relative to one camera alone
    [(100.0, 1.0), (300.0, 1.02), ((0.0, 250.0, 100.0, 30.0, 300.0), 1.0)],
)
def test_messages_that_come_late_are_tracked_at_their_own_times(
    late_ms: float | Sequence[float], others: float
) -> None:
    target = tracker_node()
    results = play(target, stream("front"), stream("back", late_ms, phase_ms=30))
    alone_m, punctual_m = rms_in_time_m()
    assert rms(errors_m(results, "back")) < 1.1 * punctual_m
    assert rms(errors_m(results, "front")) < others * alone_m
    assert {t.id for answer in results for t in answer.tracks} == {1}
    assert target.status().counters["stale"] == 0


def test_the_newest_tracks_do_not_wait_for_a_late_camera() -> None:
    target = tracker_node()
    for mount in MOUNTS:
        target.handle(mount, 0)
    waits_ms = []
    arrivals = [*stream("front")[:100], *stream("back", 300.0)[:100]]
    for at_ms, frame in sorted(arrivals, key=lambda item: item[0]):
        now_ns = int(at_ms * MS)
        outputs = []
        while (wake_ns := target.wake_ns()) is not None and wake_ns < now_ns:
            outputs += [(wake_ns, t) for t in target.tick(wake_ns)]
        outputs += [(now_ns, t) for t in target.handle(frame, now_ns)]
        waits_ms += [
            (ns - t.stamp_ns + START_NS) / MS
            for ns, t in outputs
            if isinstance(t, Tracks) and t.camera == "front"
        ]
    assert max(waits_ms) == DELAY_MS


def test_a_frame_later_than_a_second_is_dropped_and_counted() -> None:
    # One frame in five; if all frames were late, the clock would be corrected.
    target = tracker_node()
    back = list(stream("back", phase_ms=30))
    late = [(at_ms + 1100.0 * (k % 5 == 4), frame) for k, (at_ms, frame) in enumerate(back)]
    play(target, stream("front"), late)
    counters = target.status().counters
    assert counters["stale"] + counters["stray_frames"] == pytest.approx(FRAMES / 5, abs=2)


def final_clocks(target: TrackerNode) -> tuple[float, float]:
    gauges = target.status().gauges
    return gauges["camera_offset_back_ms"], gauges["camera_delay_back_ms"]


@pytest.mark.parametrize(
    ("ahead_ms", "late_ms"),
    [(-100.0, 0.0), (-500.0, 0.0), (500.0, 0.0), (0.0, 200.0), (100.0, 200.0)],
)
def test_people_separate_the_clock_of_a_camera_from_the_delay_of_its_messages(
    ahead_ms: float, late_ms: float
) -> None:
    target = tracker_node()
    results = play(target, stream("front"), stream("back", late_ms, ahead_ms, phase_ms=30))
    offset_ms, delay_ms = final_clocks(target)
    assert offset_ms == pytest.approx(ahead_ms, abs=20.0)
    assert delay_ms == pytest.approx(late_ms, abs=20.0)
    assert rms(errors_m(results, "back", ahead_ms)) < 0.04


def test_long_delay_corrected_as_a_clock_is_restored_by_people() -> None:
    target = tracker_node()
    frames = FRAMES * 3 // 2  # it takes longer
    play(target, stream("front", frames=frames), stream("back", 600.0, 0.0, 30, frames))
    np.testing.assert_allclose(final_clocks(target), (0.0, 600.0), atol=20.0)


def test_standing_people_change_no_stamps() -> None:
    target = tracker_node()
    still = [
        [(at_ms, replace(f, detections=(person(0.5),))) for at_ms, f in arrivals]
        for arrivals in (stream("front"), stream("back", 150.0, phase_ms=30))
    ]
    play(target, *still)
    np.testing.assert_allclose(final_clocks(target), (0.0, 150.0), atol=2.0)
