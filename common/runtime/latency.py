"""The way of a message, piece by piece, from its trace."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from common.transport.clock import SAME, Offset
from people4d.messages import Span

ARRIVALS = ("queue", "capture")  # after these a message may wait for others, or for its time


@dataclass(frozen=True, slots=True)
class Part:
    """One piece of the way, on the reference clock where the clocks are known.

    Args:
        service: Service that did the work, or that received what was on its way.
        process: Its process, "<instance>@<host>".
        stage: One of `common.transport.trace.STAGES`, or a service's own.
        start_ns: When it began.
        end_ns: When it ended; before `start_ns` if the clocks are farther apart than told.
        error_ns: Bound of the error that clocks bring into its duration: 0 on one host; None: it
            is between hosts whose clocks were not compared.
    """

    service: str
    process: str
    stage: str
    start_ns: int
    end_ns: int
    error_ns: float | None = 0.0

    @property
    def name(self) -> str:
        """Name in tables, "<service>.<stage>"."""
        return f"{self.service}.{self.stage}"

    @property
    def instance(self) -> str:
        """Process without its host."""
        return self.process.partition("@")[0]

    @property
    def ms(self) -> float:
        """Duration in milliseconds, negative if the clocks say so."""
        return (self.end_ns - self.start_ns) / 1e6


def parts(trace: Sequence[Span], clocks: Mapping[str, Offset] | None = None) -> list[Part]:
    """Split the way of a message into its stages and what lies between them.

    The pieces follow each other without a gap: what no process measured is `transport` between
    two processes, `wait` after an arrival, and `other` between the stages of a process.

    Args:
        trace: Stages passed, oldest first.
        clocks: Offsets by host; hosts that are absent keep their own time.
    """
    known = clocks or {}
    found = [_part(span, known) for span in trace[:1]]
    for before, after in pairwise(trace):
        found += [*_between(before, after, known), _part(after, known)]
    return found


def summed(pieces: Sequence[Part]) -> list[Part]:
    """Return the pieces of a way with those of one process and stage put together.

    What was put together begins with the first of them and lasts as long as all of them.
    """
    found: dict[tuple[str, str], Part] = {}
    for part in pieces:
        key = part.process, part.stage
        before = found.get(key)
        longer_ns = part.end_ns - part.start_ns
        found[key] = replace(before, end_ns=before.end_ns + longer_ns) if before else part
    return list(found.values())


def whole(trace: Sequence[Span], clocks: Mapping[str, Offset] | None = None) -> Part | None:
    """Return the whole way as one piece, from the first stage to the last; None without any."""
    if not trace:
        return None
    known = clocks or {}
    return Part(
        service="",
        process=trace[-1].process,
        stage="whole",
        start_ns=_reference_ns(trace[0].start_ns, trace[0], known),
        end_ns=_reference_ns(trace[-1].end_ns, trace[-1], known),
        error_ns=_error_ns(trace[0], trace[-1], known),
    )


class Window:
    """Durations of the last seconds.

    Args:
        seconds: How long they count.
        most: How many are kept at most, the newest.
    """

    def __init__(self, seconds: float, most: int = 4096) -> None:
        self._seconds = seconds
        self._samples: deque[tuple[float, float]] = deque(maxlen=most)

    def add(self, now_s: float, value: float) -> None:
        """Take a value."""
        self._samples.append((now_s, value))

    def values(self, now_s: float) -> list[float]:
        """Return the values that count now, oldest first."""
        while self._samples and self._samples[0][0] < now_s - self._seconds:
            self._samples.popleft()
        return [value for _, value in self._samples]


def percentiles(values: Sequence[float]) -> tuple[float, float, float]:
    """Return the 50th, 95th and 99th percentile of at least one value."""
    p50, p95, p99 = np.percentile(values, (50, 95, 99))
    return float(p50), float(p95), float(p99)


def host_of(span: Span) -> str:
    """Return the host on whose clock a span is."""
    return span.process.partition("@")[2]


def _part(span: Span, clocks: Mapping[str, Offset]) -> Part:
    service, _, stage = span.stage.partition(".")
    return Part(
        service=service,
        process=span.process,
        stage=stage,
        start_ns=_reference_ns(span.start_ns, span, clocks),
        end_ns=_reference_ns(span.end_ns, span, clocks),
    )


def _between(before: Span, after: Span, clocks: Mapping[str, Offset]) -> list[Part]:
    """Return what lies between two stages as a piece, none if one begins where the other ends."""
    same = before.process == after.process
    if same and before.end_ns == after.start_ns:
        return []
    arrived = before.stage.rpartition(".")[2] in ARRIVALS
    return [
        Part(
            service=after.stage.partition(".")[0],
            process=after.process,
            stage="transport" if not same else "wait" if arrived else "other",
            start_ns=_reference_ns(before.end_ns, before, clocks),
            end_ns=_reference_ns(after.start_ns, after, clocks),
            error_ns=_error_ns(before, after, clocks),
        )
    ]


def _reference_ns(time_ns: int, span: Span, clocks: Mapping[str, Offset]) -> int:
    return time_ns - round(clocks.get(host_of(span), SAME).offset_ns)


def _error_ns(before: Span, after: Span, clocks: Mapping[str, Offset]) -> float | None:
    hosts = host_of(before), host_of(after)
    if hosts[0] == hosts[1]:
        return 0.0
    if not all(host in clocks for host in hosts):
        return None
    return sum(clocks[host].error_ns for host in hosts)
