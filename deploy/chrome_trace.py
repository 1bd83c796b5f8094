"""The path of frames through processes, in the format of chrome://tracing and Perfetto.

Source: Trace Event Format, https://docs.google.com/document/d/1CvAClvFfyA5R-PhYUmn5OOQtYMH4h6I0nSsKchNAySU
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from common.runtime.latency import TraceSegment, segments
from common.transport.clock import HostOffset
from deploy.monitor import clocks_of, of_frame
from people4d.messages import Detections, Embeddings, Health, Message, Span, Tracks

KINDS = (Detections, Embeddings, Tracks, Health)
PATH_LANE, WORK = 100, 1  # first lanes (threads) of a process: what comes to it, what it does
UNKNOWN = "clock not compared"

Event = dict[str, Any]
Frame = tuple[str, int, int]  # camera, sequence, stamp


class FrameTraces:
    """Gathers the traces of frames from messages; what several tell of one is put together."""

    def __init__(self) -> None:
        self.traces: dict[Frame, list[tuple[Span, ...]]] = defaultdict(list)
        self._healths: dict[str, Health] = {}

    @property
    def clocks(self) -> dict[str, HostOffset]:
        """Offsets of the clocks of hosts, as far as heartbeats report them."""
        return clocks_of(self._healths.values())

    def add(self, message: Message) -> None:
        """Take a message; those of other kinds than `KINDS` are passed over."""
        if isinstance(message, Health):
            self._healths[message.instance] = message
        elif isinstance(message, Detections | Embeddings | Tracks) and of_frame(message.trace):
            frame = (message.camera, message.sequence, message.stamp_ns)
            self.traces[frame].append(message.trace)

    def chrome(self) -> dict[str, Any]:
        """Return the trace, to be written as JSON."""
        clocks = self.clocks
        return {
            "traceEvents": list(_events(self.traces, clocks)),
            "displayTimeUnit": "ms",
            "otherData": {
                "frames": len(self.traces),
                "clocks_ahead_of_the_router": {
                    host: {"offset_ms": c.offset_ns / 1e6, "error_ms": c.error_ns / 1e6}
                    for host, c in clocks.items()
                },
            },
        }


@dataclass
class _Lanes:
    """Threads of one process: what happens at the same time lies in different ones."""

    first: int
    ends_ns: list[int] = field(default_factory=list)

    def take(self, start_ns: int, end_ns: int) -> int:
        """Return the first lane that is free then."""
        for lane, busy_until_ns in enumerate(self.ends_ns):
            if busy_until_ns <= start_ns:
                self.ends_ns[lane] = end_ns
                return self.first + lane
        self.ends_ns.append(end_ns)
        return self.first + len(self.ends_ns) - 1


def _events(
    traces: Mapping[Frame, list[tuple[Span, ...]]], clocks: Mapping[str, HostOffset]
) -> Iterator[Event]:
    """Yield all events: processes first, then frame by frame."""
    paths = {frame: _frame_path(found, clocks) for frame, found in traces.items()}
    starts_ns = [part.start_ns for path in paths.values() for part in path]
    zero_ns = min(starts_ns, default=0)
    writer = _Writer(zero_ns)
    ordered = sorted(paths.items(), key=lambda item: item[1][0].start_ns)
    body = [event for frame, path in ordered for event in writer.frame(frame, path)]
    yield from writer.processes(clocks)
    yield from body


def _frame_path(
    traces: Iterable[tuple[Span, ...]], clocks: Mapping[str, HostOffset]
) -> list[TraceSegment]:
    """Return the pieces of a frame's path by their start; messages share those they have in common.

    `other` is left out: it is the gap that one sees.
    """
    found = {part for trace in traces for part in segments(trace, clocks) if part.stage != "other"}
    return sorted(found, key=lambda part: (part.start_ns, part.end_ns))


class _Writer:
    """Makes events.

    Args:
        zero_ns: Time at which the snapshot begins.
    """

    def __init__(self, zero_ns: int) -> None:
        self._zero_ns = zero_ns
        self._pids: dict[str, int] = {}
        self._names: dict[int, str] = {}
        self._lanes: dict[tuple[int, int], _Lanes] = {}
        self._arrows = 0

    def processes(self, clocks: Mapping[str, HostOffset]) -> Iterator[Event]:
        """Yield the names of processes and lanes."""
        for process, pid in self._pids.items():
            offset = clocks.get(process.partition("@")[2])
            label = UNKNOWN
            if offset:
                label = f"clock {offset.offset_ns / 1e6:+.2f} ± {offset.error_ns / 1e6:.2f} ms"
            yield _meta("process_name", pid, 0, name=process)
            yield _meta("process_labels", pid, 0, labels=label)
            yield _meta("process_sort_index", pid, 0, sort_index=pid)
            for (owner, first), lanes in self._lanes.items():
                for tid in range(first, first + len(lanes.ends_ns)) if owner == pid else ():
                    name = "work" if first == WORK else "on the path here"
                    yield _meta("thread_name", pid, tid, name=name)

    def frame(self, frame: Frame, path: list[TraceSegment]) -> Iterator[Event]:
        """Yield the events of one frame: a slice in each process, its stages in it, arrows."""
        fields = {"camera": frame[0], "sequence": frame[1], "stamp_ns": frame[2]}
        by_process: dict[str, list[TraceSegment]] = defaultdict(list)
        for part in path:
            self._pid(part.process)  # numbered in the order of the path
            if part.stage == "transport":
                yield self._transport(part, fields)
            else:
                by_process[part.process].append(part)
        drawn: dict[TraceSegment, int] = {}
        for process, work in by_process.items():
            yield from self._work(process, work, fields, drawn)
        for part in path:
            if part.stage == "transport":
                yield from self._arrow(part, drawn)

    def _work(
        self, process: str, work: list[TraceSegment], fields: Event, drawn: dict[TraceSegment, int]
    ) -> Iterator[Event]:
        """Yield what one process did for a frame; what overlaps goes to lanes of its own."""
        pid, groups = self._pid(process), list[list[TraceSegment]]()
        for part in work:
            fits = (g for g in groups if g[-1].end_ns <= part.start_ns)
            group = next(fits, None)
            if group is None or part.end_ns < part.start_ns:
                groups.append([part])
            else:
                group.append(part)
        for group in groups:
            first, last = group[0], max(group, key=lambda part: part.end_ns)
            tid = self._lane(pid, WORK, first.start_ns, last.end_ns)
            outer = (first.start_ns, last.end_ns)
            yield self._slice(f"frame {fields['sequence']}", "frame", pid, tid, outer, fields)
            for part in group:
                drawn[part] = tid
                span = (part.start_ns, part.end_ns)
                yield self._slice(part.stage, part.service, pid, tid, span, fields)

    def _transport(self, part: TraceSegment, fields: Event) -> Event:
        pid = self._pid(part.process)
        clock_ms = None if part.error_ns is None else part.error_ns / 1e6
        fields = fields | {"ms": part.ms, "clock_error_ms": clock_ms}
        tid = self._lane(pid, PATH_LANE, part.start_ns, max(part.end_ns, part.start_ns))
        return self._slice(
            "transport", part.service, pid, tid, (part.start_ns, part.end_ns), fields
        )

    def _arrow(self, path: TraceSegment, drawn: Mapping[TraceSegment, int]) -> Iterator[Event]:
        """Yield an arrow from what the sender did last to what the receiver did first."""
        sent = next(
            (p for p in drawn if p.end_ns == path.start_ns and p.process != path.process), None
        )
        came = next(
            (p for p in drawn if p.start_ns == path.end_ns and p.process == path.process), None
        )
        if sent is None or came is None:
            return
        self._arrows += 1
        for phase, part in (("s", sent), ("f", came)):
            yield {
                "name": "frame",
                "cat": "flow",
                "ph": phase,
                "id": self._arrows,
                "pid": self._pid(part.process),
                "tid": drawn[part],
                "ts": self._us(part.start_ns),
                **({"bp": "e"} if phase == "f" else {}),
            }

    def _slice(
        self, name: str, category: str, pid: int, tid: int, span_ns: tuple[int, int], fields: Event
    ) -> Event:
        """Return a slice; one that ends before it begins is a mark that tells so."""
        start_ns, end_ns = span_ns
        event = {"name": name, "cat": category, "pid": pid, "tid": tid, "args": fields}
        if end_ns < start_ns:
            late_ms = (end_ns - start_ns) / 1e6
            mark = {"name": f"{name} {late_ms:.3f} ms: clocks disagree", "ph": "i", "s": "t"}
            return event | mark | {"ts": self._us(start_ns)}
        return event | {"ph": "X", "ts": self._us(start_ns), "dur": (end_ns - start_ns) / 1e3}

    def _lane(self, pid: int, first: int, start_ns: int, end_ns: int) -> int:
        return self._lanes.setdefault((pid, first), _Lanes(first)).take(start_ns, end_ns)

    def _pid(self, process: str) -> int:
        return self._pids.setdefault(process, len(self._pids) + 1)

    def _us(self, time_ns: int) -> float:
        return (time_ns - self._zero_ns) / 1e3


def _meta(kind: str, pid: int, tid: int, **fields: Any) -> Event:
    return {"name": kind, "ph": "M", "pid": pid, "tid": tid, "args": fields}
