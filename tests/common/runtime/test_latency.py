"""The way of a message, by hand."""

from hypothesis import given
from hypothesis import strategies as st

from common.runtime.latency import Window, parts, summed, whole
from common.transport.clock import Offset
from people4d.messages import Span

MS = 1_000_000


def span(stage: str, start_ms: float, end_ms: float, process: str) -> Span:
    start_ns, end_ns = round(start_ms * MS), round(end_ms * MS)
    return Span(stage=stage, process=process, start_ns=start_ns, end_ns=end_ns)


def way() -> list[Span]:
    """A frame on its way from host a to host b, whose clock is 100 ms ahead."""
    return [
        span("camera.release", 0, 1, "camera-1@a"),
        span("camera.publish", 1, 3, "camera-1@a"),
        span("detector.decode", 107, 108, "detector-1@b"),
        span("detector.queue", 108, 110, "detector-1@b"),
        span("detector.inference", 111, 121, "detector-1@b"),
        span("detector.publish", 123, 124, "detector-1@b"),
    ]


CLOCKS = {"a": Offset(0.0, 0.0), "b": Offset(100 * MS, 0.5 * MS)}


def test_what_no_process_measured_is_named_by_where_it_lies() -> None:
    got = [(part.name, part.ms, part.error_ns) for part in parts(way(), CLOCKS)]
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
    total = whole(way(), CLOCKS)
    assert total is not None
    assert (total.ms, total.error_ns) == (124 - 100, 0.5 * MS)


def test_clocks_that_were_not_compared_are_told_as_unknown() -> None:
    transport = parts(way())[2]
    assert (transport.ms, transport.error_ns) == (104, None)
    total = whole(way(), {"a": Offset(0.0, 0.0)})
    assert total is not None
    assert (total.ms, total.error_ns) == (124, None)


def test_a_negative_time_is_told_as_it_is() -> None:
    behind = {"a": Offset(0.0, 0.0), "b": Offset(105 * MS, 2 * MS)}  # 107 - 105 < 3
    assert parts(way(), behind)[2].ms == -1


def test_errors_of_two_compared_hosts_add_up() -> None:
    clocks = {"a": Offset(7 * MS, 0.25 * MS), "b": Offset(107 * MS, 0.5 * MS)}
    transport = parts(way(), clocks)[2]
    assert (transport.ms, transport.error_ns) == (4, 0.75 * MS)


def test_pieces_of_one_process_and_stage_are_put_together() -> None:
    trace = [
        span("a.x", 0, 1, "a@h"),
        span("a.y", 2, 3, "a@h"),
        span("a.x", 6, 7, "a@h"),
    ]
    got = {part.stage: part.ms for part in summed(parts(trace))}
    assert got == {"x": 2, "other": 1 + 3, "y": 1}


def test_no_trace_has_no_way() -> None:
    assert parts([]) == []
    assert whole([]) is None


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
def test_the_pieces_are_the_whole(spans: list[Span], offset_ns: int) -> None:
    """Whatever the clocks say, even times that go backwards: nothing is lost, nothing is twice."""
    for clocks in ({}, {"x": Offset(offset_ns, 1.0), "y": Offset(0.0, 1.0)}):
        pieces, total = parts(spans, clocks), whole(spans, clocks)
        assert total is not None
        length_ns = total.end_ns - total.start_ns
        assert sum(part.end_ns - part.start_ns for part in pieces) == length_ns
        put_together = summed(pieces)
        assert sum(part.end_ns - part.start_ns for part in put_together) == length_ns


def test_a_window_forgets() -> None:
    window = Window(10.0)
    for now_s, value in ((0.0, 1.0), (5.0, 2.0), (10.0, 3.0)):
        window.add(now_s, value)
    assert window.values(10.0) == [1.0, 2.0, 3.0]
    assert window.values(10.5) == [2.0, 3.0]
    assert window.values(30.0) == []


def test_a_window_is_bounded() -> None:
    window = Window(10.0, most=3)
    for value in range(5):
        window.add(0.0, value)
    assert window.values(0.0) == [2, 3, 4]
