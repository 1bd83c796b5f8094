"""How far the clocks of hosts are apart, and how sure that is.

Every process asks the router's host for the time, as NTP does: four stamps tell the difference of
two clocks to within half of the time that question and answer were on their way. So all clocks are
known relative to one.
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

NAME = "clock"
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
KEPT = 64  # exchanges
DRIFT = 1e-4  # two quartz clocks part by less than so much of the time: 50 ppm each
ROUNDING_NS = 1.0  # of the stamps
ASK_S = 1.0


@dataclass(frozen=True, slots=True)
class Offset:
    """How far a clock is ahead of the reference.

    Args:
        offset_ns: What its time must be lessened by to be the reference's.
        error_ns: Bound of the error of that.
    """

    offset_ns: float
    error_ns: float


SAME = Offset(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Exchange:
    """One question and its answer.

    Source: RFC 5905, section 8: offset and round-trip delay.

    Args:
        asked_ns: When the question left, own clock.
        heard_ns: When it came, the other's clock.
        told_ns: When the answer left, the other's clock.
        received_ns: When that came, own clock.
    """

    asked_ns: int
    heard_ns: int
    told_ns: int
    received_ns: int

    @property
    def offset_ns(self) -> float:
        """Own clock minus the other's, if both ways took the same time."""
        return ((self.asked_ns - self.heard_ns) + (self.received_ns - self.told_ns)) / 2

    @property
    def error_ns(self) -> float:
        """Bound of the error: all of the way was there, or all of it was back."""
        return ((self.received_ns - self.asked_ns) - (self.told_ns - self.heard_ns)) / 2

    def at(self, now_ns: int) -> Offset:
        """Return what this tells about a later time: meanwhile, and before, clocks drift."""
        drifting_ns = abs(now_ns - self.received_ns) + abs(self.told_ns - self.heard_ns)
        return Offset(self.offset_ns, self.error_ns + DRIFT * drifting_ns + ROUNDING_NS)


class Comparison:
    """Two clocks, compared again and again; the quickest answers tell the most."""

    def __init__(self) -> None:
        self.steps = 0  # times that one of the clocks was set
        self._exchanges: deque[Exchange] = deque(maxlen=KEPT)

    def add(self, exchange: Exchange) -> None:
        """Take an exchange; one that contradicts those before tells that a clock was set."""
        new, known = exchange.at(exchange.received_ns), self.offset(exchange.received_ns)
        if new.error_ns < 0:  # the clock was set while the question was on its way
            return
        if known:
            apart_ns = abs(new.offset_ns - known.offset_ns)
            if apart_ns > new.error_ns + known.error_ns:
                self._exchanges.clear()
                self.steps += 1
        self._exchanges.append(exchange)

    def offset(self, now_ns: int) -> Offset | None:
        """Return the offset with the least error, None before the first answer.

        Args:
            now_ns: Own clock.
        """
        known = (exchange.at(now_ns) for exchange in self._exchanges)
        return min(known, key=lambda offset: offset.error_ns, default=None)


class Answer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the reference answers."""

    clock: str  # which clock that is, see this_clock
    heard_ns: int  # [ns] its clock when the question came
    told_ns: int  # [ns] its clock when the answer left


class Asker(Protocol):
    """Carries questions to other processes."""

    def ask(self, name: str, on_answer: Callable[[bytes], None]) -> None:
        """Send a question; `on_answer` gets the answer in another thread, or is never called."""
        ...


class Questions(Asker, Protocol):
    """Carries questions to other processes, and answers theirs."""

    def answer(self, name: str, reply: Callable[[], bytes]) -> None:
        """Answer a question whenever it is put, in a thread of its own."""
        ...


def this_clock() -> str:
    """Return what tells this machine's clock from others: containers of one machine share it."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:  # not Linux
        return socket.gethostname()


def keep_time(bus: Questions, clock: str = "", now_ns: Callable[[], int] = time.time_ns) -> None:
    """Be the reference: answer everyone who asks for the time.

    Args:
        bus: Carries the questions.
        clock: Which clock is told; empty for this machine's.
        now_ns: The clock.
    """
    clock = clock or this_clock()

    def reply() -> bytes:
        heard_ns = now_ns()
        return msgspec.msgpack.encode(Answer(clock, heard_ns, now_ns()))

    bus.answer(NAME, reply)


class Clock:
    """This host's clock beside the reference.

    Args:
        bus: Carries the questions.
        clock: Which clock this is, empty for this machine's; with that of the reference there is
            nothing to compare.
        now_ns: The clock.
    """

    def __init__(
        self, bus: Asker, clock: str = "", now_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._bus, self._clock, self._now_ns = bus, clock or this_clock(), now_ns
        self._comparison = Comparison()
        self._same = False
        self._asked_s = 0.0
        self._lock = threading.Lock()
        self.bad_answers = 0

    def ask(self) -> None:
        """Ask the reference, at most once a second; returns at once."""
        if time.monotonic() - self._asked_s < ASK_S:
            return
        self._asked_s = time.monotonic()
        asked_ns = self._now_ns()
        self._bus.ask(NAME, lambda answer: self._heard(asked_ns, answer, self._now_ns()))

    def offset(self) -> Offset | None:
        """Return how far this clock is ahead of the reference; None if nobody answered."""
        with self._lock:
            return SAME if self._same else self._comparison.offset(self._now_ns())

    def gauges(self) -> dict[str, float]:
        """Return offset and error in milliseconds by name, none before the first answer."""
        offset = self.offset()
        if offset is None:
            return {}
        ms = offset.offset_ns / 1e6, offset.error_ns / 1e6
        return {"clock_offset_ms": ms[0], "clock_error_ms": ms[1]}

    def counters(self) -> dict[str, int]:
        """Return how often a clock was set, and answers that could not be read."""
        return {"clock_steps": self._comparison.steps, "bad_clock": self.bad_answers}

    def _heard(self, asked_ns: int, payload: bytes, received_ns: int) -> None:
        try:
            answer = msgspec.msgpack.decode(payload, type=Answer)
        except msgspec.DecodeError:
            self.bad_answers += 1
            return
        with self._lock:
            self._same = answer.clock == self._clock
            self._comparison.add(Exchange(asked_ns, answer.heard_ns, answer.told_ns, received_ns))
