"""The figures of the summary, worked by hand."""

import msgspec
import pytest

from common.runtime.synchroniser import SynchronisedFrame
from people4d.messages import Detection, Message
from services.report.even_sample import EvenSample
from services.report.statistics import Latency, RunStatistics, RunSummary
from services.report.text import facts, latency_table, text
from tests.report.builders import (
    MS,
    detection,
    detections,
    frame,
    health,
    info,
    pose,
    span,
    track,
    tracks,
    truth,
)

S = 10**9


def test_percentiles() -> None:
    latency = Latency()
    for ms in range(101):  # 0, 1, ... 100 ms: percentile p is p ms
        latency.add_trace([span("detector.inference", 0, ms)])
    got = latency.percentiles()["detector.inference"]
    assert (got.p50_ms, got.p95_ms, got.p99_ms, got.count) == (50.0, 95.0, 99.0, 101)


def test_latency_is_stages_transport_and_the_rest() -> None:
    latency = Latency()
    latency.add_trace(
        [
            span("camera.read", 0, 4),  # 4 ms
            span("detector.preprocess", 6, 9),  # 2 ms on the way, 3 ms
            span("detector.inference", 10, 40),  # 1 ms between stages of a process, 30 ms
            span("tracker.update", 45, 47),  # 5 ms on the way, 2 ms
        ]
    )
    p50 = {name: p.p50_ms for name, p in latency.percentiles().items()}
    assert p50 == {
        "camera.read": 4,
        "detector.transport": 2,
        "detector.preprocess": 3,
        "detector.inference": 30,
        "detector.other": 1,
        "tracker.transport": 5,
        "tracker.update": 2,
        "end_to_end": 47,
    }
    assert list(p50)[-1] == "end_to_end"
    assert sum(ms for name, ms in p50.items() if name != "end_to_end") == p50["end_to_end"]


def test_pieces_of_one_name_are_one() -> None:
    """Two gaps of 1 and 3 ms in one message are 4 ms of `other`, not two samples."""
    latency = Latency()
    latency.add_trace(
        [span("detector.a", 0, 1), span("detector.b", 2, 3), span("detector.c", 6, 7)]
    )
    other = latency.percentiles()["detector.other"]
    assert (other.p50_ms, other.count) == (4, 1)


def test_two_replicas_of_a_service_are_one_stage() -> None:
    latency = Latency()
    for process, ms in (("detector-1", 10), ("detector-2", 30)):
        latency.add_trace(
            [span("camera.read", 0, 1), span("detector.inference", 2, 2 + ms, process)]
        )
    assert latency.percentiles()["detector.inference"].p50_ms == 20  # mean of 10 and 30
    assert latency.percentiles()["detector.transport"].count == 2


def test_a_message_without_trace_changes_nothing() -> None:
    latency = Latency()
    latency.add_trace([])
    assert latency.percentiles() == {}


def scored(*messages: Message) -> RunSummary:
    """Statistics of a run with these messages."""
    statistics = RunStatistics()
    for message in messages:
        statistics.add_message(message, 0)
    return statistics.summary()


def test_score_by_hand() -> None:
    people = [truth(k * 100 * MS, ("a", 0.0, 0.0), ("b", 5.0, 0.0)) for k in range(4)]
    # Errors of a: 0.3, 0.4 and 0 m; b is matched once, 0.5 m off; that at 9 m is a false alarm.
    got = scored(
        *people,
        tracks(0, [track(1, 0.3), track(2, 5.5)]),
        tracks(100 * MS, [track(1, 0.0, 0.4), track(3, 9.0)]),
        tracks(200 * MS, [track(7, 0.0)]),  # a is now 7: one switch
    )
    assert got.score is not None
    total = got.score
    assert (total.frames, total.truths, total.matched, total.false_alarms) == (3, 6, 4, 1)
    assert got.position_error_median_m == pytest.approx(0.35)  # of 0, 0.3, 0.4, 0.5
    # 0 + 0.09 + 0.16 + 0.25 = 0.5
    assert total.position_rmse_m == pytest.approx((0.5 / 4) ** 0.5)
    assert total.velocity_rmse_mps == 0.0
    assert total.id_switches == 1


def test_people_out_of_view_are_not_scored() -> None:
    behind = truth(0, ("a", 2.0, 0.0), ("b", -5.0, 0.0))
    got = scored(info(), pose(), behind, tracks(0, [track(1, 2.0)])).score
    assert got is not None
    assert (got.truths, got.matched, got.outside) == (1, 1, 1)


def test_without_truth_there_is_no_score() -> None:
    got = scored(tracks(0, [track(1, 0.0)]))
    assert (got.score, got.position_error_median_m) == (None, None)


def summary_of_a_run() -> RunSummary:
    """Four frames at 10 Hz, the last unanswered; 1, 2 and 0 people, one without a position."""
    statistics = RunStatistics()
    with_position, unplaced = detection(), detection(position=False)
    people: tuple[list[Detection], ...] = ([with_position], [with_position, unplaced], [])
    for k in range(4):
        statistics.add_message(frame(k * 100 * MS), 0)
    for k in range(3):
        stamp_ns, trace = k * 100 * MS, (span("camera.read", 0, 4), span("tracker.update", 5, 7))
        found = detections(stamp_ns, people[k])
        tracked = tracks(stamp_ns, [track(1, 1.0)] + [track(2, 3.0)] * (k == 1), trace=trace)
        statistics.add_message(found, k * S)
        statistics.add_message(tracked, k * S // 4)  # 4 Hz by the clock
        statistics.settle(SynchronisedFrame("front", stamp_ns, frame(stamp_ns), found, tracked))
    statistics.settle(SynchronisedFrame("front", 300 * MS, frame(0)))
    statistics.add_message(tracks(350 * MS, [track(1, 9.0)]), 9 * S)  # predicted between frames
    statistics.settle(
        SynchronisedFrame("front", 350 * MS, tracks=tracks(350 * MS, [track(1, 9.0)]))
    )
    counters = {"received_frames": 4, "frames": 4, "dropped_frames": 1, "bad_frames": 0}
    statistics.add_message(health(**counters), 0)
    return statistics.summary()


def test_summary_by_hand() -> None:
    got = summary_of_a_run()
    assert (got.frames, got.frames_detected, got.frames_tracked) == (4, 3, 3)
    assert got.recorded_hz == pytest.approx(10.0)
    assert got.processed_hz == pytest.approx(4.0)
    assert (got.people, got.people_per_frame) == (3, 1.0)
    assert got.position_share == pytest.approx(2 / 3)
    assert got.tracks == 2
    assert (got.track_length_mean, got.track_length_median) == (2.0, 2.0)  # 3 frames and 1
    assert got.latency["end_to_end"].p50_ms == 7.0
    assert got.drops == {"detector-1": {"dropped_frames": 1}}
    assert got.score is None
    assert got.missing == ("Truth",)


def test_summary_in_words_and_json() -> None:
    summary = summary_of_a_run()
    words = text(summary)
    assert "4 in, 3 detected, 3 tracked, recorded at 10.0 Hz, processed at 4.0 Hz" in words
    assert "66.7% with a 3D position" in words
    assert "detector-1: dropped_frames 1" in words
    assert ("truth", "none") in facts(summary)
    assert ("missing", "Truth") in facts(summary)
    assert ("end_to_end", "7.0", "7.0", "7.0") in latency_table(summary)
    assert msgspec.json.decode(msgspec.json.encode(summary), type=RunSummary) == summary


def test_nothing_came() -> None:
    summary = RunStatistics().summary()
    assert summary.missing == ("RgbdFrame", "Detections", "Tracks", "Truth", "Health")
    assert summary.people_per_frame is None
    assert "none" in text(summary)


def test_the_last_word_of_each_process_counts() -> None:
    statistics = RunStatistics()
    for n in (1, 5):
        statistics.add_message(health(errors=n), 0)
    assert statistics.summary().drops == {"detector-1": {"errors": 5}}


@pytest.mark.parametrize("count", [0, 1, 3, 4, 8, 9, 17, 1000])
def test_spread_is_bounded_and_even(count: int) -> None:
    spread: EvenSample[int] = EvenSample(4)
    for k in range(count):
        if spread.is_next:
            spread.add_value(k)
        else:
            spread.skip()
    assert spread.count == count
    assert min(count, 4) <= len(spread.values) <= 8
    steps = {b - a for a, b in zip(spread.values, spread.values[1:], strict=False)}
    assert len(steps) <= 1
    assert spread.values[:1] == [0][:count]


def test_pick_keeps_first_and_last() -> None:
    spread: EvenSample[int] = EvenSample(10)
    for k in range(11):
        spread.add_value(k)
    assert spread.pick(3) == [0, 5, 10]
    assert spread.pick(1) == [0]
    assert spread.pick(50) == list(range(11))
