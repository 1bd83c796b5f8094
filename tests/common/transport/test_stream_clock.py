"""Wall times of stamps: of live cameras, of recordings in loops, of slow and replayed ones."""

from typing import Any

import pytest

from common.transport.stream_clock import StreamClock
from people4d.messages import Span, Tracks
from tests import builders

MS = 1_000_000
S = 1_000 * MS
NOW_NS = 1_800_000_000 * S
MONTHS_NS = 120 * 24 * 3600 * S


class Wall:
    """A wall clock that a test sets."""

    now_ns = NOW_NS

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture
def wall() -> Wall:
    return Wall()


def tracks(
    stamp_ns: int, camera: str = "camera-1", sent_ns: int | None = None, stage: str = "release"
) -> Tracks:
    trace: tuple[Any, ...] = ()
    if sent_ns is not None:
        trace = (
            Span(stage=f"camera.{stage}", process="a@b", start_ns=sent_ns, end_ns=sent_ns + MS),
        )
    return builders.tracks(stamp_ns=stamp_ns, camera=camera, trace=trace)


@pytest.mark.parametrize("late_ms", [0, 40, 3000, -800])
def test_stamps_near_the_wall_clock_are_by_it(wall: Wall, late_ms: int) -> None:
    stamp_ns = NOW_NS - late_ms * MS
    assert StreamClock(wall).wall_ns(tracks(stamp_ns)) == stamp_ns


@pytest.mark.parametrize("ahead_ns", [-MONTHS_NS, MONTHS_NS, 5 * S])
def test_recording_is_mapped_to_the_time_at_which_its_source_sends(
    wall: Wall, ahead_ns: int
) -> None:
    clock = StreamClock(wall)
    for k in range(3):
        sent_ns = NOW_NS + k * 33 * MS
        wall.now_ns = sent_ns + 120 * MS + k * MS  # including 120 ms in the pipeline
        assert clock.wall_ns(tracks(sent_ns + ahead_ns, sent_ns=sent_ns + k * MS)) == sent_ns


def test_offset_follows_a_recording_that_begins_again(wall: Wall) -> None:
    clock, first_ns = StreamClock(wall), NOW_NS - MONTHS_NS
    clock.wall_ns(tracks(first_ns))
    wall.now_ns += 20 * S
    assert clock.wall_ns(tracks(first_ns + 20 * S)) == wall.now_ns
    wall.now_ns += 33 * MS
    assert clock.wall_ns(tracks(first_ns)) == wall.now_ns


def test_offset_follows_a_recording_that_is_played_slowly(wall: Wall) -> None:
    clock, stamp_ns = StreamClock(wall), NOW_NS - MONTHS_NS
    for _ in range(100):  # a third of its speed
        wall.now_ns += 99 * MS
        stamp_ns += 33 * MS
        shown_ns = clock.wall_ns(tracks(stamp_ns, sent_ns=wall.now_ns))
        assert abs(shown_ns - wall.now_ns) <= 100 * MS


def test_late_messages_of_a_live_camera_stay_late(wall: Wall) -> None:
    clock = StreamClock(wall)
    clock.wall_ns(tracks(NOW_NS, sent_ns=NOW_NS, stage="capture"))
    wall.now_ns += 4 * S
    assert clock.wall_ns(tracks(NOW_NS + S)) == NOW_NS + S


def test_late_messages_of_a_recording_stay_late(wall: Wall) -> None:
    clock, stamp_ns = StreamClock(wall), NOW_NS - MONTHS_NS
    clock.wall_ns(tracks(stamp_ns, sent_ns=NOW_NS))
    wall.now_ns += 4 * S
    assert clock.wall_ns(tracks(stamp_ns + S, sent_ns=NOW_NS + S)) == NOW_NS + S


def test_old_trace_of_a_replay_is_ignored(wall: Wall) -> None:
    stamp_ns = NOW_NS - MONTHS_NS
    assert StreamClock(wall).wall_ns(tracks(stamp_ns, sent_ns=stamp_ns + MS)) == NOW_NS


def test_cameras_that_begin_one_after_the_other_share_one_time(wall: Wall) -> None:
    clock, stamp_ns = StreamClock(wall), NOW_NS - MONTHS_NS
    assert clock.wall_ns(tracks(stamp_ns, "a", NOW_NS)) == NOW_NS
    wall.now_ns += 300 * MS  # the second camera's process starts later, with the same stamps
    assert clock.wall_ns(tracks(stamp_ns, "b", wall.now_ns)) == NOW_NS


def test_camera_of_another_clock_has_its_own_time(wall: Wall) -> None:
    clock = StreamClock(wall)
    assert clock.wall_ns(tracks(NOW_NS - MONTHS_NS, "a")) == NOW_NS
    assert clock.wall_ns(tracks(MONTHS_NS, "b")) == NOW_NS
    assert clock.wall_ns(tracks(NOW_NS - MONTHS_NS, "a")) == NOW_NS


def test_invented_cameras_do_not_grow_the_clock(wall: Wall) -> None:
    clock = StreamClock(wall)
    clock.wall_ns(tracks(NOW_NS - MONTHS_NS, "a"))
    for number in range(200):
        clock.wall_ns(tracks(number * S, f"invented-{number}"))
    assert clock.wall_ns(tracks(NOW_NS - MONTHS_NS + S, "a")) == NOW_NS + S
    assert clock.wall_ns(tracks(NOW_NS - MONTHS_NS + S, "late-comer")) == NOW_NS + S
