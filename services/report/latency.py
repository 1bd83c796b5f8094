"""How long each stage took, from the trace of messages."""

from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np

from common.messages import Span
from services.report.spread import Spread

SAMPLES = 10_000  # kept of each stage
MAX_STAGES = 128
WHOLE, OTHER = "whole", "other"


class Percentiles(msgspec.Struct, frozen=True, kw_only=True):
    """Distribution of a duration."""

    p50_ms: float  # [ms] median
    p95_ms: float  # [ms]
    p99_ms: float  # [ms]
    count: int  # messages measured


class Latency:
    """Durations of stages, of the way between processes, and of the whole.

    The whole is the sum of the stages, of the ways "a -> b" from the last stage in one process to
    the first in the next, and of "other", the gaps between the stages of a process. Between
    machines whose clocks differ, a way holds the difference of the clocks.
    """

    def __init__(self) -> None:
        self._samples: dict[str, Spread[float]] = {}

    def add(self, trace: Sequence[Span]) -> None:
        """Take the trace of one message, oldest stage first."""
        if not trace:
            return
        self._take(trace[0].stage, _ms(trace[0].start_ns, trace[0].end_ns))
        other_ms = 0.0
        for before, after in pairwise(trace):
            gap_ms = _ms(before.end_ns, after.start_ns)
            if before.process == after.process:
                other_ms += gap_ms
            else:
                self._take(f"{_service(before)} -> {_service(after)}", gap_ms)
            self._take(after.stage, _ms(after.start_ns, after.end_ns))
        self._take(OTHER, other_ms)
        self._take(WHOLE, _ms(trace[0].start_ns, trace[-1].end_ns))

    def percentiles(self) -> dict[str, Percentiles]:
        """Return the distribution of each stage in the order of the way, the whole last."""
        last = (OTHER, WHOLE)
        names = [n for n in self._samples if n not in last]
        return {
            name: _percentiles(self._samples[name])
            for name in (*names, *last)
            if name in self._samples
        }

    def _take(self, name: str, duration_ms: float) -> None:
        if name in self._samples or len(self._samples) < MAX_STAGES:
            self._samples.setdefault(name, Spread(SAMPLES)).add(duration_ms)


def _percentiles(samples: Spread[float]) -> Percentiles:
    p50, p95, p99 = np.percentile(samples.values, (50, 95, 99))
    return Percentiles(p50_ms=float(p50), p95_ms=float(p95), p99_ms=float(p99), count=samples.count)


def _service(span: Span) -> str:
    return span.stage.partition(".")[0]


def _ms(start_ns: int, end_ns: int) -> float:
    return (end_ns - start_ns) / 1e6
