"""Times of stages."""

import threading

import pytest

from common.messages import Span
from common.trace import collect, span


def test_spans_are_gathered_in_order_under_the_service() -> None:
    with collect("detector", "detector-1@robot") as spans:
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
    with collect("a", "a@h") as spans:
        pass
    with span("late"):
        pass
    assert spans == []


def test_a_failed_stage_is_measured_too() -> None:
    with collect("a", "a@h") as spans:
        with pytest.raises(RuntimeError), span("broken"):
            raise RuntimeError
        with span("next"):
            pass
    assert [s.stage for s in spans] == ["a.broken", "a.next"]


def test_threads_do_not_see_each_others_spans() -> None:
    both = threading.Barrier(2, timeout=10)
    seen: dict[str, list[Span]] = {}

    def work(name: str) -> None:
        with collect(name, f"{name}@h") as spans:
            both.wait()
            with span(name):
                both.wait()
        seen[name] = spans

    threads = [threading.Thread(target=work, args=(name,)) for name in ("a", "b")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10)
    assert {n: [s.stage for s in spans] for n, spans in seen.items()} == {
        "a": ["a.a"],
        "b": ["b.b"],
    }
