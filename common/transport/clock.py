"""Offsets between the clocks of hosts, each with a bound of its error.

Every process queries the time of the router's host, as NTP does: four stamps give the offset of two
clocks to within half of the round-trip time.
"""

import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import msgspec

CLOCK = "clock"  # name of the query
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
EXCHANGES_MAX = 64
DRIFT = 1e-4  # maximum relative drift of two quartz clocks, 50 ppm each
ROUNDING_NS = 1.0  # rounding error of stamps [ns]
QUERY_PERIOD_S = 1.0


@dataclass(frozen=True, slots=True)
class HostOffset:
    """Offset of a host's clock."""

    offset_ns: float  # time of the host minus time of the reference
    error_ns: float  # bound of the error of offset_ns


NO_OFFSET = HostOffset(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class TimeExchange:
    """One query and its reply, as in docs/method.md section 24 [Mills 2010]."""

    query_sent_ns: int  # [ns] own clock
    query_received_ns: int  # time of reception on the other clock
    reply_sent_ns: int  # time of sending on the other clock
    reply_received_ns: int  # [ns] own clock

    @property
    def offset_ns(self) -> float:
        """Own clock minus the other's [ns], assuming equal delays of query and reply."""
        query_ns = self.query_sent_ns - self.query_received_ns
        return (query_ns + self.reply_received_ns - self.reply_sent_ns) / 2

    @property
    def error_ns(self) -> float:
        """Bound of the error [ns], if the whole delay is in the query or in the reply."""
        served_ns = self.reply_sent_ns - self.query_received_ns
        return (self.reply_received_ns - self.query_sent_ns - served_ns) / 2

    def at(self, now_ns: int) -> HostOffset:
        """Return the offset at another time, with the drift of the clocks in its error."""
        served_ns = abs(self.reply_sent_ns - self.query_received_ns)
        drifting_ns = abs(now_ns - self.reply_received_ns) + served_ns
        return HostOffset(self.offset_ns, self.error_ns + DRIFT * drifting_ns + ROUNDING_NS)


class ClockFilter:
    """Offset of two clocks from many exchanges; the fastest exchange is the most accurate."""

    def __init__(self) -> None:
        self.steps = 0  # number of clock steps
        self._exchanges: deque[TimeExchange] = deque(maxlen=EXCHANGES_MAX)

    def add_exchange(self, exchange: TimeExchange) -> None:
        """Add an exchange; a contradiction with earlier ones shows that a clock was set."""
        new, known = (
            exchange.at(exchange.reply_received_ns),
            self.offset(exchange.reply_received_ns),
        )
        if new.error_ns < 0:  # the clock was set during the query
            return
        if known:
            apart_ns = abs(new.offset_ns - known.offset_ns)
            if apart_ns > new.error_ns + known.error_ns:
                self._exchanges.clear()
                self.steps += 1
        self._exchanges.append(exchange)

    def offset(self, now_ns: int) -> HostOffset | None:
        """Return the offset with the minimum error, None before the first reply."""
        known = (exchange.at(now_ns) for exchange in self._exchanges)
        return min(known, key=lambda offset: offset.error_ns, default=None)


class TimeReply(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Reply of the reference."""

    clock: str  # identity of the clock, see clock_id
    query_received_ns: int  # [ns] time of reception on its clock
    reply_sent_ns: int  # [ns] time of sending on its clock


class QuerySender(Protocol):
    """Sends queries to other processes."""

    def query(self, name: str, on_reply: Callable[[bytes], None]) -> None:
        """Send a query; `on_reply` gets the reply in another thread, or is never called."""
        ...


class QueryServer(Protocol):
    """Replies to queries of other processes."""

    def serve(self, name: str, reply: Callable[[], bytes]) -> None:
        """Reply to every query of a name, in a thread of its own."""
        ...


def clock_id() -> str:
    """Return the identity of this machine's clock, which its containers share."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:  # not Linux
        return socket.gethostname()


def serve_time(bus: QueryServer, clock: str = "", now_ns: Callable[[], int] = time.time_ns) -> None:
    """Reply to all queries of the time as the reference.

    Args:
        bus: Bus of the queries.
        clock: Identity of the clock; empty: clock of this machine.
        now_ns: Returns the time of the clock [ns].
    """
    clock = clock or clock_id()

    def reply() -> bytes:
        query_received_ns = now_ns()
        return msgspec.msgpack.encode(TimeReply(clock, query_received_ns, now_ns()))

    bus.serve(CLOCK, reply)


class ClockMonitor:
    """Offset of this host's clock from the reference.

    Args:
        bus: Bus of the queries.
        clock: Identity of this clock, empty: clock of this machine. The reference itself is not
            compared.
        now_ns: Returns the time of the clock [ns].
    """

    def __init__(
        self, bus: QuerySender, clock: str = "", now_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._bus, self._clock, self._now_ns = bus, clock or clock_id(), now_ns
        self._filter = ClockFilter()
        self._is_reference = False
        self._queried_s = 0.0
        self._lock = threading.Lock()
        self.bad_replies = 0

    def query(self) -> None:
        """Query the reference without waiting, at most once a second."""
        if time.monotonic() - self._queried_s < QUERY_PERIOD_S:
            return
        self._queried_s = time.monotonic()
        sent_ns = self._now_ns()
        self._bus.query(CLOCK, lambda payload: self._receive(sent_ns, payload, self._now_ns()))

    def offset(self) -> HostOffset | None:
        """Return the offset from the reference; None before the first reply."""
        with self._lock:
            return NO_OFFSET if self._is_reference else self._filter.offset(self._now_ns())

    def gauges(self) -> dict[str, float]:
        """Return offset and error in milliseconds by name, none before the first reply."""
        offset = self.offset()
        if offset is None:
            return {}
        ms = offset.offset_ns / 1e6, offset.error_ns / 1e6
        return {"clock_offset_ms": ms[0], "clock_error_ms": ms[1]}

    def counters(self) -> dict[str, int]:
        """Return the number of clock steps and of unreadable replies."""
        return {"clock_steps": self._filter.steps, "bad_clock": self.bad_replies}

    def _receive(self, sent_ns: int, payload: bytes, received_ns: int) -> None:
        try:
            reply = msgspec.msgpack.decode(payload, type=TimeReply)
        except (msgspec.DecodeError, UnicodeDecodeError):
            self.bad_replies += 1
            return
        stamps_ns = sent_ns, reply.query_received_ns, reply.reply_sent_ns, received_ns
        with self._lock:
            self._is_reference = reply.clock == self._clock
            self._filter.add_exchange(TimeExchange(*stamps_ns))
