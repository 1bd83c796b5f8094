"""Duration of each stage, from the trace of messages."""

from collections.abc import Sequence

import msgspec

from common.runtime.latency import end_to_end, merge_stages, percentiles, segments
from people4d.messages import Span
from services.report.even_sample import EvenSample

SAMPLES = 10_000  # of each stage
MAX_STAGES = 128
END_TO_END = "end_to_end"


class Percentiles(msgspec.Struct, frozen=True, kw_only=True):
    """Distribution of a duration."""

    p50_ms: float  # [ms] median
    p95_ms: float  # [ms]
    p99_ms: float  # [ms]
    count: int  # messages measured


class Latency:
    """Durations of all segments of the trace, and end to end, which is their sum.

    Between machines whose clocks differ, `transport` holds the difference of the clocks.
    """

    def __init__(self) -> None:
        self._samples: dict[str, EvenSample[float]] = {}

    def add(self, trace: Sequence[Span]) -> None:
        """Take the trace of one message, oldest stage first; segments of one name are one."""
        for segment in merge_stages(segments(trace)):
            self._add(segment.name, segment.ms)
        if total := end_to_end(trace):
            self._add(END_TO_END, total.ms)

    def percentiles(self) -> dict[str, Percentiles]:
        """Return the distribution of each stage in the order of the trace, end to end last."""
        names = sorted(self._samples, key=lambda name: name == END_TO_END)
        return {name: _percentiles(self._samples[name]) for name in names}

    def _add(self, name: str, duration_ms: float) -> None:
        if name in self._samples or len(self._samples) < MAX_STAGES:
            self._samples.setdefault(name, EvenSample(SAMPLES)).add(duration_ms)


def _percentiles(samples: EvenSample[float]) -> Percentiles:
    p50, p95, p99 = percentiles(samples.values)
    return Percentiles(p50_ms=p50, p95_ms=p95, p99_ms=p99, count=samples.count)
