"""Latency of a message, split into segments from its trace."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from common.transport.clock import NO_OFFSET, HostOffset
from people4d.messages import Span

ARRIVALS = ("queue", "capture")  # stages after which a message may wait for others, or for its time


@dataclass(frozen=True, slots=True)
class TraceSegment:
    """One segment of a message's path, on the reference clock if offsets are known."""

    service: str  # service of the work, or receiver of the message
    process: str  # process of the stage, "<instance>@<host>"
    stage: str  # one of `common.transport.trace.STAGES`, or a service's own
    start_ns: int  # [ns] start of the stage
    end_ns: int  # [ns] end; before `start_ns` if the offset of the clocks is wrong
    # [ns] bound of the clock error in the duration: 0 on one host; None: clocks were not compared
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
        """Duration in milliseconds, negative if the clocks disagree."""
        return (self.end_ns - self.start_ns) / 1e6


def segments(
    trace: Sequence[Span], clocks: Mapping[str, HostOffset] | None = None
) -> list[TraceSegment]:
    """Split the path of a message into its stages and the time between them.

    Segments are contiguous: unmeasured time is `transport` between two processes, `wait` after an
    arrival, and `other` between the stages of a process.

    Args:
        trace: Stages, oldest first.
        clocks: Offsets by host; absent hosts keep their own time.
    """
    known = clocks or {}
    found = [_segment(span, known) for span in trace[:1]]
    for before, after in pairwise(trace):
        found += [*_between(before, after, known), _segment(after, known)]
    return found


def merge_stages(path: Sequence[TraceSegment]) -> list[TraceSegment]:
    """Merge the segments of each process and stage.

    A merged segment begins with its first part and lasts as long as the sum of its parts.
    """
    found: dict[tuple[str, str], TraceSegment] = {}
    for segment in path:
        key = segment.process, segment.stage
        before = found.get(key)
        longer_ns = segment.end_ns - segment.start_ns
        found[key] = replace(before, end_ns=before.end_ns + longer_ns) if before else segment
    return list(found.values())


def end_to_end(
    trace: Sequence[Span], clocks: Mapping[str, HostOffset] | None = None
) -> TraceSegment | None:
    """Return the path as one segment, from the first stage to the last; None if it has no stage."""
    if not trace:
        return None
    known = clocks or {}
    return TraceSegment(
        service="",
        process=trace[-1].process,
        stage="end_to_end",
        start_ns=_reference_ns(trace[0].start_ns, trace[0], known),
        end_ns=_reference_ns(trace[-1].end_ns, trace[-1], known),
        error_ns=_error_ns(trace[0], trace[-1], known),
    )


class SlidingWindow:
    """Durations of the last seconds."""

    def __init__(self, seconds: float, max_count: int = 4096) -> None:
        self._seconds = seconds
        self._samples: deque[tuple[float, float]] = deque(maxlen=max_count)

    def add_value(self, now_s: float, value: float) -> None:
        """Add a value."""
        self._samples.append((now_s, value))

    def values(self, now_s: float) -> list[float]:
        """Return the values in the window, oldest first."""
        while self._samples and self._samples[0][0] < now_s - self._seconds:
            self._samples.popleft()
        return [value for _, value in self._samples]


def percentiles(values: Sequence[float]) -> tuple[float, float, float]:
    """Return the 50th, 95th and 99th percentile of at least one value."""
    p50, p95, p99 = np.percentile(values, (50, 95, 99))
    return float(p50), float(p95), float(p99)


def host_of(span: Span) -> str:
    """Return the host whose clock timed a span."""
    return span.process.partition("@")[2]


def _segment(span: Span, clocks: Mapping[str, HostOffset]) -> TraceSegment:
    service, _, stage = span.stage.partition(".")
    return TraceSegment(
        service=service,
        process=span.process,
        stage=stage,
        start_ns=_reference_ns(span.start_ns, span, clocks),
        end_ns=_reference_ns(span.end_ns, span, clocks),
    )


def _between(before: Span, after: Span, clocks: Mapping[str, HostOffset]) -> list[TraceSegment]:
    """Return the time between two stages as a segment; an empty list if there is none."""
    same = before.process == after.process
    if same and before.end_ns == after.start_ns:
        return []
    arrived = before.stage.rpartition(".")[2] in ARRIVALS
    return [
        TraceSegment(
            service=after.stage.partition(".")[0],
            process=after.process,
            stage="transport" if not same else "wait" if arrived else "other",
            start_ns=_reference_ns(before.end_ns, before, clocks),
            end_ns=_reference_ns(after.start_ns, after, clocks),
            error_ns=_error_ns(before, after, clocks),
        )
    ]


def _reference_ns(time_ns: int, span: Span, clocks: Mapping[str, HostOffset]) -> int:
    return time_ns - round(clocks.get(host_of(span), NO_OFFSET).offset_ns)


def _error_ns(before: Span, after: Span, clocks: Mapping[str, HostOffset]) -> float | None:
    hosts = host_of(before), host_of(after)
    if hosts[0] == hosts[1]:
        return 0.0
    if not all(host in clocks for host in hosts):
        return None
    return sum(clocks[host].error_ns for host in hosts)
