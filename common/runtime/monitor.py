"""Monitor of a running system: processes, stages and clocks, over the last seconds."""

import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import msgspec

from common.runtime.latency import (
    SlidingWindow,
    TraceSegment,
    end_to_end,
    merge_stages,
    percentiles,
    segments,
)
from common.runtime.throughput import losses
from common.transport.clock import ClockMonitor, HostOffset
from common.transport.trace import ProcessId, Tracer
from people4d.client import Client
from people4d.messages import Detections, Health, Message, Span, Tracks
from people4d.queue import Arrival

FRESH_S = 3.0  # maximum silence of a process [s]
MAX_PROCESSES = 256
MAX_STAGES = 2048
FORGET_PERIOD_S = 1.0
MAX_WAITING = 256  # maximum number of frames with detections and without tracks


class Durations(msgspec.Struct, frozen=True, kw_only=True):
    """Percentiles of the durations of one stage, over the last seconds."""

    stage: str  # see common.transport.trace.STAGES; "end_to_end": from the first stage to the last
    p50_ms: float  # [ms] median
    p95_ms: float  # [ms]
    p99_ms: float  # [ms]
    count: int  # number of measured messages
    # [ms] bound of the clock error: 0 on one host; null: clocks of two hosts were not compared
    error_ms: float | None
    parallel: bool = False  # parallel work for the same frames, which does not delay them


class ProcessSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """Figures of one process."""

    service: str  # service of the process
    instance: str  # name of the process
    host: str  # name of the machine
    state: str = ""  # state in its heartbeat; empty if there is no heartbeat
    reason: str = ""  # reason of a state other than ready
    rates_hz: dict[str, float] = {}  # [Hz] messages received_ and sent_, by topic
    ages_ms: dict[str, float] = {}  # [ms] time since the newest input arrived, by topic
    losses: dict[str, int] = {}  # number of lost messages and errors since the start, by cause
    cpu_percent: float | None = None  # processor time, 100 is one core
    memory_mb: float | None = None  # resident memory
    stages: list[Durations] = []  # durations of the stages, in processing order


class ClockSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """The clock of one host."""

    host: str  # name of the machine
    offset_ms: float | None  # [ms] offset ahead of the router's clock; null: unknown
    error_ms: float | None  # [ms] bound of the error of the offset


class SystemSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """State of a system at one time."""

    seconds: float  # [s] period of the figures of stages
    # latency from the first stage of a frame to the arrival of its tracks; null: no frames
    end_to_end: Durations | None
    clocks: list[ClockSnapshot]  # clocks of all known hosts
    processes: list[ProcessSnapshot]  # processes on the path in its order, then the others


@dataclass(frozen=True)
class FramePath:
    """The path of one frame."""

    tracks: Tracks  # end of the path
    parts: list[TraceSegment]  # segments up to this listener
    parallel: list[TraceSegment]  # parallel work for the frame
    end_to_end: TraceSegment  # time from the first stage to the last

    @property
    def stages(self) -> list[TraceSegment]:
        """Stages of all processes, each once, parallel work last."""
        return merge_stages(self.parts) + merge_stages(self.parallel)


class Monitor:
    """Statistics of the last seconds, in bounded memory, at the end of the path of frames."""

    def __init__(self, process_id: ProcessId, seconds: float) -> None:
        self._process_id = process_id
        self._tracer = Tracer(process_id)
        self._seconds = seconds
        self._lock = threading.Lock()
        self._health: dict[str, tuple[float, Health]] = {}
        self._stages: dict[tuple[str, str, bool], _Stage] = {}
        self._detections: dict[tuple[str, int], tuple[Span, ...]] = {}  # traces by camera, stamp
        self._forgot_s = -FORGET_PERIOD_S
        self._end_to_end = _Stage(seconds)
        self.clocks: dict[str, HostOffset] = {}

    def follow(
        self, client: Client, *more: type[Message]
    ) -> Iterator[tuple[Arrival, FramePath | None]]:
        """Receive the messages of a system; yield each with the path of its frame, if complete.

        Args:
            client: Client of the system.
            more: Types of message besides Health, Tracks and Detections.
        """
        clock = ClockMonitor(client.session)
        for arrival in client.arrivals(Health, Tracks, Detections, *more):
            clock.query()
            with self._lock:
                offset = clock.offset()
                if offset:
                    self.clocks[self._process_id.host] = offset
                path = self.add_arrival(arrival, time.time_ns(), time.monotonic())
            yield arrival, path

    def add_arrival(self, arrival: Arrival, now_ns: int, now_s: float) -> FramePath | None:
        """Add a message; return the path of a frame once its Tracks arrive.

        Health, Tracks and Detections are used, other messages ignored. `now_ns` is the wall clock,
        `now_s` the monotonic clock.
        """
        message = arrival.message
        if isinstance(message, Health):
            self._add_health(message, now_s)
        elif isinstance(message, Detections):
            self._detections[message.camera, message.stamp_ns] = message.trace
            while len(self._detections) > MAX_WAITING:
                del self._detections[next(iter(self._detections))]
        elif isinstance(message, Tracks) and of_frame(message.trace):
            taken = self._tracer.taken(message, arrival.received_ns, arrival.decoded_ns, now_ns)
            path = self._frame_path(taken)
            self._add_frame_path(path, now_s)
            return path
        return None

    def _add_health(self, health: Health, now_s: float) -> None:
        if health.instance not in self._health and len(self._health) >= MAX_PROCESSES:
            self._forget(now_s)
            if len(self._health) >= MAX_PROCESSES:
                return
        self._health[health.instance] = (now_s, health)
        clocks = clocks_of(self.healths(now_s))
        self.clocks = clocks if len(self.clocks) > MAX_PROCESSES else self.clocks | clocks

    def _forget(self, now_s: float) -> None:
        """Delete silent processes and stages, at most once a second."""
        if now_s - self._forgot_s < FORGET_PERIOD_S:
            return
        self._forgot_s = now_s
        self._health = {k: v for k, v in self._health.items() if now_s - v[0] < FRESH_S}
        self._stages = {k: v for k, v in self._stages.items() if v.durations(now_s)}

    def healths(self, now_s: float) -> list[Health]:
        """Return the fresh heartbeats, sorted by instance."""
        fresh = (h for when_s, h in self._health.values() if now_s - when_s < FRESH_S)
        return sorted(fresh, key=lambda health: health.instance)

    def snapshot(self, now_s: float) -> SystemSnapshot:
        """Return the system as it is now."""
        with self._lock:
            return self._snapshot(now_s)

    def _snapshot(self, now_s: float) -> SystemSnapshot:
        healths = {health.instance: health for health in self.healths(now_s)}
        stages: dict[str, list[Durations]] = {}
        origins: dict[str, tuple[str, str]] = {}
        in_order = sorted(self._stages.items(), key=lambda item: item[1].after_ns)
        for (process, *_), stage in in_order:
            instance, _, host = process.partition("@")
            durations = stage.durations(now_s)
            if durations:
                stages.setdefault(instance, []).append(durations)
                origins.setdefault(instance, (stage.newest.service, host))
        for name, health in healths.items():
            origins.setdefault(name, (health.service, health.host))
        return SystemSnapshot(
            seconds=self._seconds,
            end_to_end=self._end_to_end.durations(now_s),
            clocks=[
                _clock(host, self.clocks.get(host))
                for host in sorted({host for _, host in origins.values()})
            ],
            processes=[
                _process(name, *origin, healths.get(name), stages.get(name, []))
                for name, origin in origins.items()
            ],
        )

    def _frame_path(self, tracks: Tracks) -> FramePath:
        passed = set(tracks.trace)
        trace = self._detections.pop((tracks.camera, tracks.stamp_ns), ())
        parallel = [segments([span], self.clocks)[0] for span in trace if span not in passed]
        total = end_to_end(tracks.trace, self.clocks)
        assert total is not None, "only messages with a trace have a path"
        return FramePath(tracks, segments(tracks.trace, self.clocks), parallel, total)

    def _add_frame_path(self, path: FramePath, now_s: float) -> None:
        stages = [(part, False) for part in merge_stages(path.parts)]
        stages += [(part, True) for part in merge_stages(path.parallel)]
        for part, parallel in stages:
            key = (part.process, part.stage, parallel)
            if key not in self._stages and len(self._stages) >= MAX_STAGES:
                self._forget(now_s)
            if key in self._stages or len(self._stages) < MAX_STAGES:
                stage = self._stages.setdefault(key, _Stage(self._seconds, parallel))
                stage.add_segment(part, now_s, part.start_ns - path.end_to_end.start_ns)
        self._end_to_end.add_segment(path.end_to_end, now_s, 0)


class _Stage:
    """Durations of one stage of one process, on the path of frames or parallel to it."""

    def __init__(self, seconds: float, parallel: bool = False) -> None:
        self._parallel = parallel
        self._window = SlidingWindow(seconds)

    def add_segment(self, part: TraceSegment, now_s: float, after_ns: int) -> None:
        """Add a segment of a path, which began `after_ns` after the first stage."""
        self.newest, self.after_ns = part, after_ns
        self._window.add_value(now_s, part.ms)

    def durations(self, now_s: float) -> Durations | None:
        """Return the durations in the window, None if there are none."""
        values_ms = self._window.values(now_s)
        if not values_ms:
            return None
        p50_ms, p95_ms, p99_ms = percentiles(values_ms)
        error_ns = self.newest.error_ns
        return Durations(
            stage=self.newest.stage,
            p50_ms=p50_ms,
            p95_ms=p95_ms,
            p99_ms=p99_ms,
            count=len(values_ms),
            error_ms=None if error_ns is None else error_ns / 1e6,
            parallel=self._parallel,
        )


def of_frame(trace: Sequence[Span]) -> bool:
    """Return True for the trace of a frame; predictions have none."""
    return bool(trace) and not any(span.stage.endswith(".prediction") for span in trace)


def clocks_of(healths: Iterable[Health]) -> dict[str, HostOffset]:
    """Return the clock offset of each host, from its process with the smallest error."""
    found: dict[str, HostOffset] = {}
    for health in healths:
        offset_ms, error_ms = (health.gauges.get(f"clock_{n}_ms") for n in ("offset", "error"))
        if offset_ms is None or error_ms is None:
            continue
        offset, best = HostOffset(offset_ms * 1e6, error_ms * 1e6), found.get(health.host)
        if best is None or offset.error_ns < best.error_ns:
            found[health.host] = offset
    return found


def _process(
    instance: str, service: str, host: str, health: Health | None, stages: list[Durations]
) -> ProcessSnapshot:
    named = ProcessSnapshot(service=service, instance=instance, host=host, stages=stages)
    if health is None:
        return named
    gauges = health.gauges
    return msgspec.structs.replace(
        named,
        state=health.state,
        reason=health.reason,
        rates_hz={n.removesuffix("_hz"): v for n, v in gauges.items() if n.endswith("_hz")},
        ages_ms={n[4:-3]: v for n, v in gauges.items() if n.startswith("age_")},
        losses=losses(health.counters),
        cpu_percent=gauges.get("cpu_percent"),
        memory_mb=gauges.get("memory_mb"),
    )


def _clock(host: str, offset: HostOffset | None) -> ClockSnapshot:
    if offset is None:
        return ClockSnapshot(host=host, offset_ms=None, error_ms=None)
    return ClockSnapshot(
        host=host, offset_ms=offset.offset_ns / 1e6, error_ms=offset.error_ns / 1e6
    )
