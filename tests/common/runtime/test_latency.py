"""Latency of a message by segments, worked out by hand."""

from hypothesis import given
from hypothesis import strategies as st

from common.runtime.latency import SlidingWindow, end_to_end, merge_stages, segments
from common.transport.clock import HostOffset
from people4d.messages import Span

MS = 1_000_000


def span(stage: str, start_ms: float, end_ms: float, process: str) -> Span:
    start_ns, end_ns = round(start_ms * MS), round(end_ms * MS)
    return Span(stage=stage, process=process, start_ns=start_ns, end_ns=end_ns)


def frame_trace() -> list[Span]:
    """Return the trace of a frame from host a to host b, whose clock is 100 ms ahead."""
    return [
        span("camera.release", 0, 1, "camera-1@a"),
        span("camera.publish", 1, 3, "camera-1@a"),
        span("detector.decode", 107, 108, "detector-1@b"),
        span("detector.queue", 108, 110, "detector-1@b"),
        span("detector.inference", 111, 121, "detector-1@b"),
        span("detector.publish", 123, 124, "detector-1@b"),
    ]


CLOCKS = {"a": HostOffset(0.0, 0.0), "b": HostOffset(100 * MS, 0.5 * MS)}


def test_unmeasured_time_is_named_by_its_position() -> None:
    got = [
        (segment.name, segment.ms, segment.error_ns) for segment in segments(frame_trace(), CLOCKS)
    ]
    assert got == [
        ("camera.release", 1, 0),
        ("camera.publish", 2, 0),
        ("detector.transport", 107 - 100 - 3, 0.5 * MS),
        ("detector.decode", 1, 0),
        ("detector.queue", 2, 0),
        ("detector.wait", 1, 0),  # after an arrival
        ("detector.inference", 10, 0),
        ("detector.other", 2, 0),  # between stages of the work
        ("detector.publish", 1, 0),
    ]
    total = end_to_end(frame_trace(), CLOCKS)
    assert total is not None
    assert (total.ms, total.error_ns) == (124 - 100, 0.5 * MS)


def test_error_is_unknown_between_clocks_that_were_not_compared() -> None:
    transport = segments(frame_trace())[2]
    assert (transport.ms, transport.error_ns) == (104, None)
    total = end_to_end(frame_trace(), {"a": HostOffset(0.0, 0.0)})
    assert total is not None
    assert (total.ms, total.error_ns) == (124, None)


def test_negative_time_stays_negative() -> None:
    behind = {"a": HostOffset(0.0, 0.0), "b": HostOffset(105 * MS, 2 * MS)}  # 107 - 105 < 3
    assert segments(frame_trace(), behind)[2].ms == -1


def test_errors_of_two_compared_hosts_add_up() -> None:
    clocks = {"a": HostOffset(7 * MS, 0.25 * MS), "b": HostOffset(107 * MS, 0.5 * MS)}
    transport = segments(frame_trace(), clocks)[2]
    assert (transport.ms, transport.error_ns) == (4, 0.75 * MS)


def test_segments_of_one_process_and_stage_are_merged() -> None:
    trace = [span("a.x", 0, 1, "a@h"), span("a.y", 2, 3, "a@h"), span("a.x", 6, 7, "a@h")]
    got = {segment.stage: segment.ms for segment in merge_stages(segments(trace))}
    assert got == {"x": 2, "other": 1 + 3, "y": 1}


def test_empty_trace_has_no_segments() -> None:
    assert segments([]) == []
    assert end_to_end([]) is None


times = st.integers(-(10**12), 10**12)


@given(
    spans=st.lists(
        st.builds(
            Span,
            stage=st.sampled_from(["a.queue", "a.work", "b.decode", "c.capture"]),
            process=st.sampled_from(["a@x", "b@x", "c@y"]),
            start_ns=times,
            end_ns=times,
        ),
        min_size=1,
        max_size=12,
    ),
    offset_ns=st.integers(-(10**9), 10**9),
)
def test_segments_add_up_to_the_end_to_end_latency(spans: list[Span], offset_ns: int) -> None:
    """No time is lost or counted twice, even if clocks jump back."""
    for clocks in ({}, {"x": HostOffset(offset_ns, 1.0), "y": HostOffset(0.0, 1.0)}):
        path, total = segments(spans, clocks), end_to_end(spans, clocks)
        assert total is not None
        length_ns = total.end_ns - total.start_ns
        assert sum(segment.end_ns - segment.start_ns for segment in path) == length_ns
        merged = merge_stages(path)
        assert sum(segment.end_ns - segment.start_ns for segment in merged) == length_ns


def test_window_drops_old_values() -> None:
    window = SlidingWindow(10.0)
    for now_s, value in ((0.0, 1.0), (5.0, 2.0), (10.0, 3.0)):
        window.add_value(now_s, value)
    assert window.values(10.0) == [1.0, 2.0, 3.0]
    assert window.values(10.5) == [2.0, 3.0]
    assert window.values(30.0) == []


def test_window_is_bounded() -> None:
    window = SlidingWindow(10.0, max_count=3)
    for value in range(5):
        window.add_value(0.0, value)
    assert window.values(0.0) == [2, 3, 4]
