"""What a running system tells of itself: processes, stages and clocks, over the last seconds."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Self

import msgspec

from common.runtime.inbox import Arrival
from common.runtime.latency import Part, Window, parts, percentiles, summed, whole
from common.runtime.losses import losses
from common.runtime.process_id import Place
from common.transport.clock import Offset
from common.transport.trace import Tracer
from people4d.messages import Detections, Health, Span, Tracks

FRESH_S = 3.0  # a process that has been silent for longer is gone
MAX_PROCESSES = 256
MAX_STAGES = 2048
MAX_WAITING = 256  # frames whose detections came and tracks did not


class Durations(msgspec.Struct, frozen=True, kw_only=True):
    """How long one stage took, over the last seconds."""

    stage: str  # see common.transport.trace.STAGES; "whole" for the whole way
    p50_ms: float  # [ms] median
    p95_ms: float  # [ms]
    p99_ms: float  # [ms]
    count: int  # messages measured
    # [ms] bound of what clocks bring into it: 0 on one host; null: between hosts whose clocks were
    # not compared, so that the figures hold their difference
    error_ms: float | None
    beside: bool = False  # done for the same frames, but nothing on their way had to wait for it

    @classmethod
    def of(cls, stage: str, values_ms: list[float], error_ms: float | None) -> Self:
        """Sum up at least one duration."""
        p50_ms, p95_ms, p99_ms = percentiles(values_ms)
        return cls(
            stage=stage,
            p50_ms=p50_ms,
            p95_ms=p95_ms,
            p99_ms=p99_ms,
            count=len(values_ms),
            error_ms=error_ms,
        )


class ProcessNow(msgspec.Struct, frozen=True, kw_only=True):
    """One process."""

    service: str  # its service
    instance: str  # its name
    host: str  # machine
    state: str = ""  # state in its heartbeat; empty if none came
    reason: str = ""  # why it is not ready
    rates_hz: dict[str, float] = {}  # [Hz] messages received_ and sent_, by topic
    ages_ms: dict[str, float] = {}  # [ms] since the newest input came, by topic
    losses: dict[str, int] = {}  # messages lost and errors since its start, by cause
    cpu_percent: float | None = None  # of one core
    memory_mb: float | None = None  # resident
    stages: list[Durations] = []  # in the order of the way


class ClockNow(msgspec.Struct, frozen=True, kw_only=True):
    """The clock of one host."""

    host: str  # machine
    offset_ms: float | None  # [ms] ahead of the router's clock; null: not known
    error_ms: float | None  # [ms] bound of the error of that


class Picture(msgspec.Struct, frozen=True, kw_only=True):
    """A system at one moment."""

    seconds: float  # [s] how long figures of stages go back
    whole: Durations | None  # from the first stage of a frame to its people here; null: no frames
    clocks: list[ClockNow]  # of all hosts that were heard of
    processes: list[ProcessNow]  # those on the way in its order, then the others


@dataclass(frozen=True)
class Way:
    """The way of one frame.

    Args:
        tracks: What it ended in.
        parts: Its pieces, to the one who listens.
        beside: What was done for the frame while its way went on elsewhere.
        whole: From the first stage to the last.
    """

    tracks: Tracks
    parts: list[Part]
    beside: list[Part]
    whole: Part


class Monitor:
    """Adds up messages in bounded memory.

    Args:
        place: Who listens: the end of the way.
        seconds: How long a frame counts.
    """

    def __init__(self, place: Place, seconds: float) -> None:
        self._place = place
        self._tracer = Tracer(place)
        self._seconds = seconds
        self._health: dict[str, tuple[float, Health]] = {}
        self._stages: dict[tuple[str, str, bool], _Stage] = {}
        self._detections: dict[tuple[str, int], tuple[Span, ...]] = {}  # traces by camera, stamp
        self._whole = _Stage(seconds)
        self.clocks: dict[str, Offset] = {}

    def add(self, arrival: Arrival, now_ns: int, now_s: float) -> Way | None:
        """Take a message.

        Args:
            arrival: Health, Tracks, or Detections, of which comes what was done for a frame beside
                its way; others are passed over.
            now_ns: Wall clock.
            now_s: Monotonic clock.

        Returns:
            The way of a frame, once its Tracks come.
        """
        message = arrival.message
        if isinstance(message, Health):
            if message.instance in self._health or len(self._health) < MAX_PROCESSES:
                self._health[message.instance] = (now_s, message)
                self.clocks |= clocks_of(self.healths(now_s))
        elif isinstance(message, Detections):
            self._detections[message.camera, message.stamp_ns] = message.trace
            while len(self._detections) > MAX_WAITING:
                del self._detections[next(iter(self._detections))]
        elif isinstance(message, Tracks) and of_frame(message.trace):
            taken = self._tracer.taken(message, arrival.received_ns, arrival.decoded_ns, now_ns)
            way = self._way(taken)
            self._add_way(way, now_s)
            return way
        return None

    def add_own_clock(self, offset: Offset | None) -> None:
        """Take how far the clock of this host is ahead of the router's."""
        if offset:
            self.clocks[self._place.host] = offset

    def healths(self, now_s: float) -> list[Health]:
        """Return the fresh heartbeats, sorted by instance."""
        fresh = (h for when_s, h in self._health.values() if now_s - when_s < FRESH_S)
        return sorted(fresh, key=lambda health: health.instance)

    def picture(self, now_s: float) -> Picture:
        """Return the system as it is now."""
        healths = {health.instance: health for health in self.healths(now_s)}
        stages: dict[str, list[Durations]] = {}
        places: dict[str, tuple[str, str]] = {}
        in_order = sorted(self._stages.items(), key=lambda item: item[1].after_ns)
        for (process, *_), stage in in_order:
            instance, _, host = process.partition("@")
            durations = stage.durations(now_s)
            if durations:
                stages.setdefault(instance, []).append(durations)
                places.setdefault(instance, (stage.service, host))
        for name, health in healths.items():
            places.setdefault(name, (health.service, health.host))
        return Picture(
            seconds=self._seconds,
            whole=self._whole.durations(now_s),
            clocks=[self._clock(host) for host in sorted({host for _, host in places.values()})],
            processes=[
                _process(name, *place, healths.get(name), stages.get(name, []))
                for name, place in places.items()
            ],
        )

    def _way(self, tracks: Tracks) -> Way:
        passed = set(tracks.trace)
        told = self._detections.pop((tracks.camera, tracks.stamp_ns), ())
        beside = [parts([span], self.clocks)[0] for span in told if span not in passed]
        total = whole(tracks.trace, self.clocks)
        assert total is not None, "only messages with a trace have a way"
        return Way(tracks, parts(tracks.trace, self.clocks), beside, total)

    def _add_way(self, way: Way, now_s: float) -> None:
        for parts_, beside in ((way.parts, False), (way.beside, True)):
            for part in summed(parts_):
                key = (part.process, part.stage, beside)
                if key in self._stages or len(self._stages) < MAX_STAGES:
                    stage = self._stages.setdefault(key, _Stage(self._seconds, beside))
                    stage.add(part, now_s, part.start_ns - way.whole.start_ns)
        self._whole.add(way.whole, now_s, 0)

    def _clock(self, host: str) -> ClockNow:
        offset = self.clocks.get(host)
        return ClockNow(
            host=host,
            offset_ms=offset.offset_ns / 1e6 if offset else None,
            error_ms=offset.error_ns / 1e6 if offset else None,
        )


class _Stage:
    """Durations of one stage of one process.

    Args:
        seconds: How long they count.
        beside: Whether it is beside the way.
    """

    def __init__(self, seconds: float, beside: bool = False) -> None:
        self._beside = beside
        self.after_ns = 0  # time since the begin of the way, of the newest frame
        self.service = self._name = ""
        self._error_ns: float | None = 0.0
        self._window = Window(seconds)

    def add(self, part: Part, now_s: float, after_ns: int) -> None:
        """Take a piece of a message's way, which began some time after the whole did."""
        self.after_ns = after_ns
        self.service, self._name, self._error_ns = part.service, part.stage, part.error_ns
        self._window.add(now_s, part.ms)

    def durations(self, now_s: float) -> Durations | None:
        """Return the durations that count now, None if there are none."""
        values_ms = self._window.values(now_s)
        error_ms = None if self._error_ns is None else self._error_ns / 1e6
        if not values_ms:
            return None
        found = Durations.of(self._name, values_ms, error_ms)
        return msgspec.structs.replace(found, beside=self._beside)


def of_frame(trace: Sequence[Span]) -> bool:
    """Return whether a trace tells the way of a frame; predictions are made without one."""
    return bool(trace) and not any(span.stage.endswith(".prediction") for span in trace)


def clocks_of(healths: Iterable[Health]) -> dict[str, Offset]:
    """Return of each host that tells it how far its clock is ahead, from its surest process."""
    found: dict[str, Offset] = {}
    for health in healths:
        offset_ms, error_ms = (health.gauges.get(f"clock_{n}_ms") for n in ("offset", "error"))
        if offset_ms is None or error_ms is None:
            continue
        offset, best = Offset(offset_ms * 1e6, error_ms * 1e6), found.get(health.host)
        if best is None or offset.error_ns < best.error_ns:
            found[health.host] = offset
    return found


def _process(
    instance: str, service: str, host: str, health: Health | None, stages: list[Durations]
) -> ProcessNow:
    named = ProcessNow(service=service, instance=instance, host=host, stages=stages)
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
