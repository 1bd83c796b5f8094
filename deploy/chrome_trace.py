"""The path of frames through processes, in the format of chrome://tracing and Perfetto.

Source: Trace Event Format, https://docs.google.com/document/d/1CvAClvFfyA5R-PhYUmn5OOQtYMH4h6I0nSsKchNAySU
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from common.runtime.latency import TraceSegment, segments
from common.runtime.monitor import clocks_of, of_frame
from common.transport.clock import HostOffset
from people4d.messages import Detections, Embeddings, Health, Message, Span, Tracks

KINDS = (Detections, Embeddings, Tracks, Health)
PATH_LANE, WORK = 100, 1  # first lanes (threads) of a process: paths to the process, its work

Event = dict[str, Any]
Frame = tuple[str, int, int]  # camera, sequence, stamp
Clocks = Mapping[str, HostOffset]


class FrameTraces:
    """Collects the traces of frames from messages, merged by frame."""

    def __init__(self) -> None:
        self.traces: dict[Frame, list[tuple[Span, ...]]] = defaultdict(list)
        self._healths: dict[str, Health] = {}

    def add_message(self, message: Message) -> None:
        """Add a message; kinds other than `KINDS` are ignored."""
        if isinstance(message, Health):
            self._healths[message.instance] = message
        elif isinstance(message, Detections | Embeddings | Tracks) and of_frame(message.trace):
            frame = (message.camera, message.sequence, message.stamp_ns)
            self.traces[frame].append(message.trace)

    def chrome(self) -> dict[str, Any]:
        """Return the trace for a JSON file: processes first, then frames."""
        clocks = clocks_of(self._healths.values())
        paths = [(frame, _frame_path(found, clocks)) for frame, found in self.traces.items()]
        paths.sort(key=lambda item: item[1][0].start_ns)
        writer = _Writer(min((part.start_ns for _, path in paths for part in path), default=0))
        body = [event for frame, path in paths for event in writer.frame(frame, path)]
        return {
            "traceEvents": [*writer.processes(clocks), *body],
            "displayTimeUnit": "ms",
            "otherData": {
                "frames": len(self.traces),
                "clocks_ahead_of_the_router": {
                    host: {"offset_ms": c.offset_ns / 1e6, "error_ms": c.error_ns / 1e6}
                    for host, c in clocks.items()
                },
            },
        }


def _frame_path(traces: Iterable[tuple[Span, ...]], clocks: Clocks) -> list[TraceSegment]:
    """Return the segments of a frame's path by their start, once each; `other` is a gap."""
    found = {part for trace in traces for part in segments(trace, clocks) if part.stage != "other"}
    return sorted(found, key=lambda part: (part.start_ns, part.end_ns))


class _Writer:
    """Creates events, with times from the beginning of the trace."""

    def __init__(self, zero_ns: int) -> None:
        self._zero_ns = zero_ns
        self._pids: dict[str, int] = {}
        # End of the last event in each lane, by process and first lane: simultaneous events are in
        # different lanes.
        self._lanes: dict[tuple[int, int], list[int]] = defaultdict(list)
        self._arrows = 0

    def processes(self, clocks: Clocks) -> Iterator[Event]:
        """Yield the names of processes and lanes."""
        for process, pid in self._pids.items():
            offset = clocks.get(process.partition("@")[2])
            label = "clock not compared"
            if offset:
                label = f"clock {offset.offset_ns / 1e6:+.2f} ± {offset.error_ns / 1e6:.2f} ms"
            yield _meta("process_name", pid, name=process)
            yield _meta("process_labels", pid, labels=label)
            yield _meta("process_sort_index", pid, sort_index=pid)
            for first, name in ((WORK, "work"), (PATH_LANE, "on the path here")):
                for tid in range(first, first + len(self._lanes[pid, first])):
                    yield _meta("thread_name", pid, name=name) | {"tid": tid}

    def frame(self, frame: Frame, path: list[TraceSegment]) -> Iterator[Event]:
        """Yield the events of one frame: a slice in each process with its stages, and arrows."""
        fields = {"camera": frame[0], "sequence": frame[1], "stamp_ns": frame[2]}
        by_process: dict[str, list[TraceSegment]] = defaultdict(list)
        transports = [part for part in path if part.stage == "transport"]
        for part in path:
            self._pid(part.process)  # numbered in processing order
            if part.stage != "transport":
                by_process[part.process].append(part)
        for part in transports:
            error_ms = None if part.error_ns is None else part.error_ns / 1e6
            tid = self._lane(part.process, PATH_LANE, part.start_ns, part.end_ns)
            more = {"ms": part.ms, "clock_error_ms": error_ms}
            yield self._slice(part, tid, fields | more)
        lanes: dict[TraceSegment, int] = {}
        for process, work in by_process.items():
            yield from self._work(process, work, fields, lanes)
        for part in transports:
            yield from self._arrow(part, lanes)

    def _work(
        self, process: str, work: list[TraceSegment], fields: Event, lanes: dict[TraceSegment, int]
    ) -> Iterator[Event]:
        """Yield the work of one process for a frame; overlapping work is in separate lanes."""
        groups: list[list[TraceSegment]] = []
        for part in work:
            fits = (g for g in groups if g[-1].end_ns <= part.start_ns <= part.end_ns)
            group = next(fits, None)
            if group is None:
                groups.append([part])
            else:
                group.append(part)
        for group in groups:
            start_ns, end_ns = group[0].start_ns, max(part.end_ns for part in group)
            tid = self._lane(process, WORK, start_ns, end_ns)
            name = f"frame {fields['sequence']}"
            outer = TraceSegment("frame", process, name, start_ns, end_ns)
            yield self._slice(outer, tid, fields)
            for part in group:
                lanes[part] = tid
                yield self._slice(part, tid, fields)

    def _arrow(self, transport: TraceSegment, lanes: Mapping[TraceSegment, int]) -> Iterator[Event]:
        """Yield an arrow from the sender's last stage to the receiver's first one."""
        process, start_ns, end_ns = transport.process, transport.start_ns, transport.end_ns
        sent = [p for p in lanes if p.end_ns == start_ns and p.process != process]
        received = [p for p in lanes if p.start_ns == end_ns and p.process == process]
        if not (sent and received):
            return
        self._arrows += 1
        for part, ends in ((sent[0], {"ph": "s"}), (received[0], {"ph": "f", "bp": "e"})):
            event = {"name": "frame", "cat": "flow", "id": self._arrows, "tid": lanes[part]}
            yield event | {"pid": self._pid(part.process), "ts": self._us(part.start_ns)} | ends

    def _slice(self, part: TraceSegment, tid: int, fields: Event) -> Event:
        """Return a slice, or a mark if it would end before it begins."""
        pid = self._pid(part.process)
        event = {"name": part.stage, "cat": part.service, "pid": pid, "tid": tid, "args": fields}
        event["ts"] = self._us(part.start_ns)
        if part.ms < 0:
            name = f"{part.stage} {part.ms:.3f} ms: clocks disagree"
            return event | {"name": name, "ph": "i", "s": "t"}
        return event | {"ph": "X", "dur": (part.end_ns - part.start_ns) / 1e3}

    def _lane(self, process: str, first: int, start_ns: int, end_ns: int) -> int:
        """Return the first free lane, and occupy it."""
        ends_ns = self._lanes[self._pid(process), first]
        free = (lane for lane, busy_until_ns in enumerate(ends_ns) if busy_until_ns <= start_ns)
        lane = next(free, len(ends_ns))
        ends_ns[lane : lane + 1] = [max(start_ns, end_ns)]
        return first + lane

    def _pid(self, process: str) -> int:
        return self._pids.setdefault(process, len(self._pids) + 1)

    def _us(self, time_ns: int) -> float:
        return (time_ns - self._zero_ns) / 1e3


def _meta(kind: str, pid: int, **fields: Any) -> Event:
    return {"name": kind, "ph": "M", "pid": pid, "tid": 0, "args": fields}
