"""Times of stages."""

import ast
import threading

import msgspec
import pytest

from common.transport.trace import STAGES, ProcessId, Tracer, collect, record, span
from people4d.codec import decode, encode
from people4d.messages import Span, Tracks
from people4d.messages.base import MAX_TRACE
from tests import ROOT
from tests.contract.examples import BY_NAME

A = ProcessId("a", "a", "h")
BEFORE = Span(stage="b.work", process="b@h", start_ns=1, end_ns=2)


def message(*trace: Span) -> Tracks:
    example = BY_NAME["Tracks"]
    assert isinstance(example, Tracks)
    return msgspec.structs.replace(example, trace=trace)


def test_spans_are_gathered_in_order_under_the_service() -> None:
    with collect(ProcessId("detector", "detector-1", "robot")) as spans:
        with span("preprocess"):
            pass
        with span("inference"):
            pass
    assert [s.stage for s in spans] == ["detector.preprocess", "detector.inference"]
    assert {s.process for s in spans} == {"detector-1@robot"}
    for s in spans:
        assert s.start_ns <= s.end_ns
    assert spans[0].end_ns <= spans[1].start_ns


def test_outside_of_collect_a_span_does_nothing() -> None:
    with collect(A) as spans:
        pass
    with span("late"):
        pass
    assert spans == []


def test_a_failed_stage_is_measured_too() -> None:
    with collect(A) as spans:
        with pytest.raises(RuntimeError), span("broken"):
            raise RuntimeError
        with span("next"):
            pass
    assert [s.stage for s in spans] == ["a.broken", "a.next"]


def test_spans_of_threads_are_separate() -> None:
    both = threading.Barrier(2, timeout=10)
    collected: dict[str, list[Span]] = {}

    def work(name: str) -> None:
        with collect(ProcessId(name, name, "h")) as spans:
            both.wait()
            with span(name):
                both.wait()
        collected[name] = spans

    threads = [threading.Thread(target=work, args=(name,)) for name in ("a", "b")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10)
    assert {n: [s.stage for s in spans] for n, spans in collected.items()} == {
        "a": ["a.a"],
        "b": ["b.b"],
    }


def test_stage_measured_elsewhere_is_recorded() -> None:
    record("nowhere", 1, 2)
    with collect(A) as spans:
        record("capture", 3, 9)
    assert spans == [Span(stage="a.capture", process="a@h", start_ns=3, end_ns=9)]


def test_trace_holds_arrival_work_and_publishing() -> None:
    tracer = Tracer(A)
    taken = tracer.taken(message(BEFORE), 10, 12, 15)
    with tracer.working() as spans:
        record("work", 16, 20)
    worked = tracer.worked(taken, spans)
    publishing = tracer.publishing(worked)
    assert publishing is not None
    trace = decode(encode(worked, publishing)).trace
    assert [(s.stage, s.start_ns, s.end_ns) for s in trace[:-1]] == [
        ("b.work", 1, 2),
        ("a.decode", 10, 12),
        ("a.queue", 12, 15),
        ("a.work", 16, 20),
    ]
    assert (trace[-1].stage, trace[-1].start_ns) == ("a.publish", 20)  # begins where work ended


def test_publishing_begins_now_where_nothing_was_measured_here() -> None:
    publishing = Tracer(A).publishing(message(BEFORE))
    assert publishing is not None
    last = publishing()
    assert 0 <= last.end_ns - last.start_ns < 1_000_000_000  # and not since BEFORE


def test_tracing_can_be_off() -> None:
    tracer, plain = Tracer(A, on=False), message(BEFORE)
    with tracer.working() as spans, span("work"):
        pass
    assert spans == []
    assert tracer.taken(plain, 1, 2, 3) is plain
    assert tracer.worked(plain, spans) is plain
    assert tracer.publishing(plain) is None


def test_a_full_trace_stays_valid() -> None:
    tracer = Tracer(A)
    full = tracer.worked(message(*[BEFORE] * MAX_TRACE), [BEFORE])
    assert len(decode(encode(full, tracer.publishing(full))).trace) == MAX_TRACE


@pytest.mark.slow
def test_every_stage_of_a_service_is_in_the_table() -> None:
    """The names are parsed from the code, so that each has a meaning."""
    names = set()
    for file in (ROOT / "services").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("span", "record"):
                names.add(ast.literal_eval(node.args[0]))
    assert {"release", "postprocess", "association"} <= names <= set(STAGES)


def test_every_stage_is_in_the_documentation() -> None:
    page = (ROOT / "docs" / "operation" / "latency.md").read_text("utf-8")
    assert [name for name in STAGES if f"\n- `{name}` (" not in page] == []
