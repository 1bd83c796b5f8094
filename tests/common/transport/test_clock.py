"""Clocks of two hosts, by hand, by chance and through a router."""

import threading
import time
from collections.abc import Callable

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.transport.clock import (
    DRIFT,
    EXCHANGES_MAX,
    NO_OFFSET,
    ClockFilter,
    ClockMonitor,
    QuerySender,
    TimeExchange,
    TimeReply,
    serve_time,
)
from tests.network import WAIT_S, Network

pytestmark = pytest.mark.network

MS = 1_000_000
S = 1_000_000_000


def test_four_stamps_by_hand() -> None:
    # Own clock is 100 ms ahead. The query takes 4 ms, the reply is made in 1 ms and takes 2 ms.
    # own 1000 -> other 1000 + 4 - 100 = 904; sent 905; received at 905 + 2 + 100 = 1007.
    exchange = TimeExchange(1000 * MS, 904 * MS, 905 * MS, 1007 * MS)
    # ((1000 - 904) + (1007 - 905)) / 2 = (96 + 102) / 2 = 99 ms; (7 - 1) / 2 = 3 ms
    assert (exchange.offset_ns, exchange.error_ns) == (99 * MS, 3 * MS)
    # After 1 s, and the 1 ms between, the clocks may differ by another 100.1 us; stamps are in
    # nanoseconds.
    assert exchange.at(2007 * MS).error_ns == 3 * MS + DRIFT * 1001 * MS + 1 == 3_100_101


def test_quickest_reply_gives_the_offset_until_it_is_old() -> None:
    clock_filter = ClockFilter()
    assert clock_filter.offset(0) is None
    clock_filter.add_exchange(TimeExchange(0, 0, 0, 2 * MS))  # 1 ms with an error of 1 ms
    clock_filter.add_exchange(
        TimeExchange(1 * S, 1 * S, 1 * S, 1 * S + 4 * MS)
    )  # 2 ms with an error of 2 ms
    now = clock_filter.offset(2 * S)  # 1 ms + 200 us, or 2 ms + 100 us
    assert now is not None
    assert now.offset_ns == 1 * MS
    later = clock_filter.offset(60 * S)  # 1 + 6.0 ms, or 2 + 5.9 ms
    assert later is not None
    assert later.offset_ns == 1 * MS
    assert later.error_ns == pytest.approx(7 * MS, rel=1e-3)


def test_clock_that_was_set_counts_as_a_step_and_discards_earlier_exchanges() -> None:
    clock_filter = ClockFilter()
    clock_filter.add_exchange(TimeExchange(0, 0, 0, 2 * MS))
    clock_filter.add_exchange(TimeExchange(10 * S, 5 * S, 5 * S, 10 * S + 2 * MS))  # now 5 s ahead
    assert clock_filter.steps == 1
    now = clock_filter.offset(10 * S)
    assert now is not None
    assert now.offset_ns == 5 * S + 1 * MS


def test_exchange_during_which_a_clock_was_set_back_is_ignored() -> None:
    clock_filter = ClockFilter()
    clock_filter.add_exchange(TimeExchange(10 * S, 0, 0, 9 * S))
    assert clock_filter.offset(9 * S) is None


DELAYS = st.integers(0, 50 * MS)


@settings(deadline=None)
@given(
    ahead_ns=st.integers(-(10**15), 10**15),
    ppm=st.floats(-99, 99),
    delays=st.lists(st.tuples(DELAYS, DELAYS, DELAYS), min_size=1, max_size=EXCHANGES_MAX),
)
def test_error_is_a_bound(ahead_ns: int, ppm: float, delays: list[tuple[int, int, int]]) -> None:
    """Query and reply may take different times, and the clocks drift within 100 ppm."""

    def own(true_ns: int) -> int:
        return true_ns + ahead_ns + round(true_ns * ppm / 1e6)

    clock_filter, true_ns = ClockFilter(), 0
    for query_ns, served_ns, reply_ns in delays:
        received_ns = true_ns + query_ns
        sent_ns = received_ns + served_ns
        clock_filter.add_exchange(
            TimeExchange(own(true_ns), received_ns, sent_ns, own(sent_ns + reply_ns))
        )
        true_ns = sent_ns + reply_ns + S
    assert clock_filter.steps == 0
    offset = clock_filter.offset(own(true_ns))
    assert offset is not None
    error_ns = abs(offset.offset_ns - (own(true_ns) - true_ns))
    assert error_ns <= offset.error_ns


class Wire:
    """Bus that replies at once."""

    def __init__(self, payload: bytes | None = None) -> None:
        self._reply: Callable[[], bytes] = lambda: payload or b""

    def query(self, name: str, on_reply: Callable[[bytes], None]) -> None:
        on_reply(self._reply())

    def serve(self, name: str, reply: Callable[[], bytes]) -> None:
        self._reply = reply


def test_processes_of_one_machine_have_no_offset() -> None:
    wire = Wire()
    serve_time(wire)
    clock = ClockMonitor(wire)
    assert clock.offset() is None
    assert clock.gauges() == {}
    clock.query()
    assert clock.offset() == NO_OFFSET


@pytest.mark.parametrize(
    "payload",
    [
        b"\xc1",
        b"",
        msgspec.msgpack.encode({"clock": 1}),
        msgspec.msgpack.encode(TimeReply("h", 1, 1))[:-1],
        msgspec.msgpack.encode({"clock": "h", "query_received_ns": 1.5, "reply_sent_ns": 1}),
    ],
)
def test_bad_reply_is_counted_and_changes_nothing(payload: bytes) -> None:
    clock = ClockMonitor(Wire(payload), "robot")
    clock.query()
    assert clock.bad_replies == 1
    assert clock.offset() is None


class SignallingMonitor(ClockMonitor):
    """Clock monitor with an event for its replies."""

    def __init__(self, bus: QuerySender, now_ns: Callable[[], int]) -> None:
        super().__init__(bus, "elsewhere", now_ns)
        self.replied = threading.Event()

    def _receive(self, sent_ns: int, payload: bytes, received_ns: int) -> None:
        super()._receive(sent_ns, payload, received_ns)
        self.replied.set()


def test_clock_ten_minutes_ahead_is_known_within_its_error_through_a_router() -> None:
    network = Network()
    ahead_ns = 600 * S
    try:
        robot = network.robot()
        serve_time(network.open(robot), "robot")
        clock = SignallingMonitor(network.open(robot), lambda: time.time_ns() + ahead_ns)
        for _ in range(int(WAIT_S)):  # the router may not know the server yet
            clock.query()
            if clock.replied.wait(1.0):
                break
    finally:
        network.close()
    offset = clock.offset()
    assert offset is not None
    assert abs(offset.offset_ns - ahead_ns) <= offset.error_ns < S


def test_query_without_a_reply_is_no_error() -> None:
    network = Network()
    try:
        clock = ClockMonitor(network.open(network.robot()), "elsewhere")
        clock.query()
    finally:
        network.close()
    assert clock.offset() is None
