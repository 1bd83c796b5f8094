"""Clocks of two hosts, by hand, by chance and through a router."""

import threading
import time
from collections.abc import Callable

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.transport.clock import (
    DRIFT,
    KEPT,
    SAME,
    Answer,
    Clock,
    Comparison,
    Exchange,
    Questions,
    keep_time,
)
from tests.network import WAIT_S, Network

MS = 1_000_000
S = 1_000_000_000


def test_four_stamps_by_hand() -> None:
    # Own clock is 100 ms ahead. The question takes 4 ms, the answer is made in 1 ms and takes 2 ms.
    # own 1000 -> other 1000 + 4 - 100 = 904; told 905; received at 905 + 2 + 100 = 1007.
    exchange = Exchange(1000 * MS, 904 * MS, 905 * MS, 1007 * MS)
    # ((1000 - 904) + (1007 - 905)) / 2 = (96 + 102) / 2 = 99 ms; (7 - 1) / 2 = 3 ms
    assert (exchange.offset_ns, exchange.error_ns) == (99 * MS, 3 * MS)
    # A second later, and in the 1 ms between, the clocks may have parted by 100.1 us; stamps are
    # whole nanoseconds.
    assert exchange.at(2007 * MS).error_ns == 3 * MS + DRIFT * 1001 * MS + 1 == 3_100_101


def test_the_quickest_answer_tells_most_until_it_is_old() -> None:
    comparison = Comparison()
    assert comparison.offset(0) is None
    comparison.add(Exchange(0, 0, 0, 2 * MS))  # 1 ms, give or take 1 ms
    comparison.add(Exchange(1 * S, 1 * S, 1 * S, 1 * S + 4 * MS))  # 2 ms, give or take 2 ms
    now = comparison.offset(2 * S)  # 1 ms + 200 us, or 2 ms + 100 us
    assert now is not None
    assert now.offset_ns == 1 * MS
    later = comparison.offset(60 * S)  # 1 + 6.0 ms, or 2 + 5.9 ms
    assert later is not None
    assert later.offset_ns == 1 * MS
    assert later.error_ns == pytest.approx(7 * MS, rel=1e-3)


def test_a_clock_that_was_set_is_noticed_and_what_was_known_before_forgotten() -> None:
    comparison = Comparison()
    comparison.add(Exchange(0, 0, 0, 2 * MS))
    comparison.add(Exchange(10 * S, 5 * S, 5 * S, 10 * S + 2 * MS))  # now 5 s ahead
    assert comparison.steps == 1
    now = comparison.offset(10 * S)
    assert now is not None
    assert now.offset_ns == 5 * S + 1 * MS


def test_a_clock_set_back_while_asking_tells_nothing() -> None:
    comparison = Comparison()
    comparison.add(Exchange(10 * S, 0, 0, 9 * S))
    assert comparison.offset(9 * S) is None


delays = st.integers(0, 50 * MS)


@given(
    ahead_ns=st.integers(-(10**15), 10**15),
    ppm=st.floats(-99, 99),
    ways=st.lists(st.tuples(delays, delays, delays), min_size=1, max_size=KEPT),
)
def test_the_error_is_a_bound(ahead_ns: int, ppm: float, ways: list[tuple[int, int, int]]) -> None:
    """However unlike the ways there and back, and however the clocks drift within 100 ppm."""

    def own(true_ns: int) -> int:
        return true_ns + ahead_ns + round(true_ns * ppm / 1e6)

    comparison, true_ns = Comparison(), 0
    for there_ns, there_until_ns, back_ns in ways:
        heard_ns = true_ns + there_ns
        told_ns = heard_ns + there_until_ns
        comparison.add(Exchange(own(true_ns), heard_ns, told_ns, own(told_ns + back_ns)))
        true_ns = told_ns + back_ns + S
    assert comparison.steps == 0
    offset = comparison.offset(own(true_ns))
    assert offset is not None
    wrong_ns = abs(offset.offset_ns - (own(true_ns) - true_ns))
    assert wrong_ns <= offset.error_ns


class Wire:
    """Answers on the spot."""

    def __init__(self, answer: bytes | None = None) -> None:
        self._reply: Callable[[], bytes] = lambda: answer or b""

    def ask(self, name: str, on_answer: Callable[[bytes], None]) -> None:
        on_answer(self._reply())

    def answer(self, name: str, reply: Callable[[], bytes]) -> None:
        self._reply = reply


def test_processes_of_one_machine_have_one_clock_and_need_no_comparison() -> None:
    wire = Wire()
    keep_time(wire)
    clock = Clock(wire)
    assert clock.offset() is None
    assert clock.gauges() == {}
    clock.ask()
    assert clock.offset() == SAME


@pytest.mark.parametrize(
    "payload",
    [
        b"\xc1",
        b"",
        msgspec.msgpack.encode({"clock": 1}),
        msgspec.msgpack.encode(Answer("h", 1, 1))[:-1],
        msgspec.msgpack.encode({"clock": "h", "heard_ns": 1.5, "told_ns": 1}),
    ],
)
def test_a_bad_answer_changes_nothing(payload: bytes) -> None:
    clock = Clock(Wire(payload), "robot")
    clock.ask()
    assert clock.bad_answers == 1
    assert clock.offset() is None


class Patient(Clock):
    """Lets a test wait for an answer."""

    def __init__(self, bus: Questions, now_ns: Callable[[], int]) -> None:
        super().__init__(bus, "elsewhere", now_ns)
        self.answered = threading.Event()

    def _heard(self, asked_ns: int, payload: bytes, received_ns: int) -> None:
        super()._heard(asked_ns, payload, received_ns)
        self.answered.set()


def test_through_a_router_a_clock_ten_minutes_ahead_is_known_within_its_error() -> None:
    network = Network()
    ahead_ns = 600 * S
    try:
        robot = network.robot()
        keep_time(network.open(robot), "robot")
        clock = Patient(network.open(robot), lambda: time.time_ns() + ahead_ns)
        for _ in range(int(WAIT_S)):  # who answers may not be known yet
            clock.ask()
            if clock.answered.wait(1.0):
                break
    finally:
        network.close()
    offset = clock.offset()
    assert offset is not None
    assert abs(offset.offset_ns - ahead_ns) <= offset.error_ns < S


def test_nobody_who_answers_is_no_error() -> None:
    network = Network()
    try:
        clock = Clock(network.open(network.robot()), "elsewhere")
        clock.ask()
    finally:
        network.close()
    assert clock.offset() is None
