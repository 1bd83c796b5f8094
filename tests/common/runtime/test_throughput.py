"""Missing streams, and streams that are too fast."""

from common.runtime.throughput import Throughput
from people4d.topics import BY_NAME

FRAMES, CROPS = BY_NAME["frames"], BY_NAME["crops"]


def test_stream_that_never_came_is_missing_after_three_seconds() -> None:
    throughput = Throughput([FRAMES], [], now_s=100.0)
    assert throughput.missing({}, 103.0) == ""
    assert throughput.missing({}, 107.0) == "no frames have come yet, for 7 s"


def test_stream_that_stopped_is_missing_until_it_comes_again() -> None:
    throughput = Throughput([FRAMES], [], now_s=100.0)
    assert throughput.missing({"received_frames": 5}, 101.0) == ""
    assert throughput.missing({"received_frames": 5}, 104.0) == ""
    assert throughput.missing({"received_frames": 5}, 105.0) == "no frames for 4 s"
    assert throughput.missing({"received_frames": 6}, 105.5) == ""


def test_output_that_stopped_is_missing_likewise() -> None:
    throughput = Throughput([], [FRAMES], now_s=0.0)
    assert throughput.missing({}, 4.0) == "no frames have been sent yet, for 4 s"
    assert throughput.missing({"sent_frames": 1}, 5.0) == ""
    assert throughput.missing({"sent_frames": 1}, 9.0) == "no frames for 4 s"


def test_skipped_frames_are_reported_with_their_rates() -> None:
    # In 2 s 60 frames arrived and newer ones replaced 38: 30 and 19 a second.
    throughput = Throughput([FRAMES], [], now_s=0.0)
    assert throughput.losing({"received_frames": 10, "dropped_frames": 0}, 0.0) == ""
    reported = throughput.losing({"received_frames": 70, "dropped_frames": 38}, 2.0)
    assert reported == "too slow: of 30.0 frames a second 19.0 are skipped"


def test_overflowing_queue_is_reported() -> None:
    throughput = Throughput([CROPS], [], now_s=0.0)
    throughput.losing({"received_crops": 0, "dropped_crops": 0}, 0.0)
    reported = throughput.losing({"received_crops": 20, "dropped_crops": 4}, 1.0)
    assert reported == "its queue overflows: of 20.0 crops a second 4.0 are lost"


def test_a_few_losses_are_no_alarm() -> None:
    throughput = Throughput([FRAMES], [], now_s=0.0)
    throughput.losing({"received_frames": 0, "dropped_frames": 0}, 0.0)
    # 2 of 4 are fewer than three; 9 of 100 are less than a tenth.
    assert throughput.losing({"received_frames": 4, "dropped_frames": 2}, 0.5) == ""
    assert throughput.losing({"received_frames": 100, "dropped_frames": 9}, 2.5) == ""


def test_losses_before_the_window_do_not_count() -> None:
    throughput = Throughput([FRAMES], [], now_s=0.0)
    throughput.losing({"received_frames": 0, "dropped_frames": 0}, 0.0)
    lost = {"received_frames": 30, "dropped_frames": 15}
    assert throughput.losing(lost, 1.0)
    assert throughput.losing(lost, 2.0)  # still within three seconds
    for second in (3.0, 4.0, 5.0):
        reported = throughput.losing(
            {"received_frames": 30 + int(10 * second), "dropped_frames": 15}, second
        )
    assert reported == ""
