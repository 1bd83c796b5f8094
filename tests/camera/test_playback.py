"""Selection and pacing of playback."""

import pytest

from services.camera.config import CameraConfig
from services.camera.pacing import LockstepPacing, RecordedPacing, SourceRate
from services.camera.playback import play
from services.camera.source import Source
from tests.camera.memory import MemorySource, capture, odometry

MS = 1_000_000
SECOND = 1_000_000_000


def stamps_ms(source: Source, selection: CameraConfig, limit: int = 100) -> list[int]:
    items = play(source, selection)
    return [item.stamp_ns // MS for _, item in zip(range(limit), items, strict=False)]


SOURCE = MemorySource([capture(5000 + 100 * k) for k in range(10)])


def test_all() -> None:
    assert stamps_ms(SOURCE, CameraConfig()) == [5000 + 100 * k for k in range(10)]


def test_start_duration_stride_and_count() -> None:
    # From 0.25 s on the first frame is at 0.3; up to 0.25 + 0.5 s the last one is at 0.7.
    assert stamps_ms(SOURCE, CameraConfig(start_s=0.25, duration_s=0.5)) == [
        5300,
        5400,
        5500,
        5600,
        5700,
    ]
    assert stamps_ms(SOURCE, CameraConfig(stride=4)) == [5000, 5400, 5800]
    assert stamps_ms(SOURCE, CameraConfig(max_frames=2)) == [5000, 5100]


def test_loop_keeps_the_rhythm_and_rises() -> None:
    # Three frames at 0, 100, 200 ms: the next round begins at 300 ms.
    source = MemorySource([capture(0), odometry(100), capture(100), capture(200)])
    expected = [0, 100, 100, 200, 300, 400, 400, 500, 600]
    assert stamps_ms(source, CameraConfig(loop=True), limit=9) == expected
    assert stamps_ms(source, CameraConfig(loop=True, max_frames=4)) == [0, 100, 100, 200, 300]


def test_loop_of_one_frame_and_of_none_at_all() -> None:
    assert stamps_ms(MemorySource([capture(7)]), CameraConfig(loop=True), limit=3) == [7, 40, 73]
    assert stamps_ms(MemorySource([odometry(7)]), CameraConfig(loop=True)) == [7]


def test_loop_over_a_clock_that_jumps_back_still_rises_between_rounds() -> None:
    # 1000, 1100, 0, 100: from least to most 1100 ms and one mean gap (1100 / 3 = 366) more.
    source = MemorySource([capture(t) for t in (1000, 1100, 0, 100)])
    assert stamps_ms(source, CameraConfig(loop=True), limit=5) == [1000, 1100, 0, 100, 2466]


def test_loop_over_a_clock_that_is_set_lasts_as_long_as_the_frames() -> None:
    # Two frames of 1970, then the clock is set to 2026: two parts of 100 ms and one mean gap
    # (200 / 3 = 66 ms) make a round of 266 ms, not of 56 years, without end.
    late = 56 * 365 * 86_400_000
    source = MemorySource([capture(t) for t in (0, 100, late, late + 100)])
    stamps = stamps_ms(source, CameraConfig(loop=True), limit=4000)
    assert stamps[:4] == [0, 100, late, late + 100]
    assert stamps[4:8] == [266, 366, late + 266, late + 366]
    assert len(stamps) == 4000


def test_recorded_rate_and_speed() -> None:
    pacing = RecordedPacing(speed=2.0)
    assert pacing.due_ns(7 * SECOND, 100) == 100
    pacing.sent(7 * SECOND, 100)
    # 50 ms of recording take 25 ms. After a late frame the next due time still counts from the
    # first frame.
    assert pacing.due_ns(7 * SECOND + 50 * MS, 200) == 100 + 25 * MS
    pacing.sent(7 * SECOND + 50 * MS, 100 + 31 * MS)
    assert pacing.due_ns(7 * SECOND + 100 * MS, 100 + 31 * MS) == 100 + 50 * MS


@pytest.mark.parametrize("jump_ns", [-5 * SECOND, 0, 11 * SECOND])
def test_recorded_rate_does_not_wait_out_a_clock_jump(jump_ns: int) -> None:
    pacing = RecordedPacing(speed=1.0)
    pacing.sent(20 * SECOND, 0)
    pacing.sent(20 * SECOND + 40 * MS, 40 * MS)
    after_ns = 20 * SECOND + 40 * MS + jump_ns
    assert pacing.due_ns(after_ns, 40 * MS) == 80 * MS  # one ordinary gap
    pacing.sent(after_ns, 80 * MS)
    assert pacing.due_ns(after_ns + 40 * MS, 80 * MS) == 120 * MS


def test_recorded_rate_does_not_rush_after_a_long_stop() -> None:
    pacing = RecordedPacing(speed=1.0)
    pacing.sent(0, 0)
    assert pacing.due_ns(33 * MS, 5 * SECOND) == 5 * SECOND
    pacing.sent(33 * MS, 5 * SECOND)
    assert pacing.due_ns(66 * MS, 5 * SECOND) == 5 * SECOND + 33 * MS


def test_lockstep_window_and_time_out() -> None:
    pacing = LockstepPacing(window=2, timeout_ns=100)
    for stamp in (1, 2):
        assert pacing.due_ns(stamp, 10 * stamp) == 10 * stamp
        pacing.sent(stamp, 10 * stamp)
    assert pacing.due_ns(3, 30) is None
    pacing.answered(77)  # an answer to nothing
    assert pacing.due_ns(3, 30) is None
    pacing.answered(2)
    assert pacing.due_ns(3, 30) == 30
    assert pacing.wake_ns() == 110
    assert pacing.give_up(109) == 0
    assert pacing.give_up(110) == 1
    assert pacing.wake_ns() is None


def test_source_slower_than_its_stamps_is_slow_with_both_rates() -> None:
    # Frames with stamps at 30 Hz arrive at 3 Hz: 15 frames in 5 s instead of 150.
    rate = SourceRate()
    for k in range(16):
        rate.add_frame(k * SECOND // 30, k * SECOND // 3)
    assert rate.is_slow
    assert (round(rate.hz), round(rate.wanted_hz)) == (3, 30)


def test_source_in_time_is_not_slow_and_a_jump_begins_its_rate() -> None:
    rate = SourceRate()
    for k in range(300):
        rate.add_frame(k * SECOND // 30, k * SECOND // 30)
    assert not rate.is_slow
    rate.add_frame(3600 * SECOND, 10 * SECOND)
    assert (rate.hz, rate.is_slow) == (0.0, False)


def test_source_that_plays_at_half_speed_is_not_slow() -> None:
    rate = SourceRate(speed=0.5)
    for k in range(300):
        rate.add_frame(k * SECOND // 30, k * SECOND // 15)
    assert (rate.is_slow, round(rate.wanted_hz)) == (False, 15)
