"""Measures of heartbeats, shared by Prometheus and OpenTelemetry."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from common.runtime.monitor import FramePath, clocks_of
from common.runtime.throughput import losses
from people4d.messages import Health, Message
from people4d.messages.status import State

# Maximum numbers of label sets, stages and cameras. Without authentication any process can send
# labels, and libraries store every set; a robot has about 1000 sets.
SAMPLES_MAX, STAGES_MAX, CAMERAS_MAX = 4096, 512, 64
LENGTH_MAX = 128  # maximum length of a label [characters]
# Upper bounds of the buckets of durations [s]
BUCKETS_S = (1e-4, 2.5e-4, 5e-4, 1e-3, 2.5e-3, 5e-3, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)
STAGE_TEXT = "Time of a frame in one stage of one process"
LATENCY_TEXT = "Time from the first stage of a frame to the arrival of its people"


@dataclass(frozen=True)
class Measure:
    """Measured quantity."""

    kind: Literal["counter", "gauge"]  # counters never decrease
    unit: str  # "s", "By" (bytes), or "1"
    text: str  # description


MEASURES = {
    "state": Measure("gauge", "1", "1 for the state of a process, 0 for other states"),
    "messages": Measure("counter", "1", "Received (in) and sent (out) messages by topic"),
    "losses": Measure("counter", "1", "Lost messages and errors by cause"),
    "input_age": Measure("gauge", "s", "Age of the newest message of a topic"),
    "cpu": Measure("gauge", "1", "CPU time of a process as a share of one core"),
    "memory": Measure("gauge", "By", "Resident memory of a process"),
    "clock_offset": Measure("gauge", "s", "Clock of a host less clock of the router"),
    "clock_error": Measure("gauge", "s", "Bound of the error of clock_offset"),
    "left_out": Measure("counter", "1", "Omitted values: too many labels, or too long ones"),
}


@dataclass(frozen=True)
class Sample:
    """One value of a measure."""

    name: str  # key of MEASURES
    value: float  # value in the unit of the measure
    labels: Mapping[str, str]  # labels, with the same names for all samples of a measure


class LabelSets:
    """Bounded number of sets of labels; counts rejected values.

    Args:
        most: Maximum number of sets; the first ones are admitted.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._known: set[tuple[str, ...]] = set()
        self.left_out = 0

    def admits(self, *labels: str) -> bool:
        """Check that a value with these labels is admitted."""
        if labels in self._known:
            return True
        if len(self._known) >= self._most or any(len(label) > LENGTH_MAX for label in labels):
            self.left_out += 1
            return False
        self._known.add(labels)
        return True


class Exporter(ABC):
    """Exports the latency and health of a system."""

    healths: Sequence[Health] = ()  # recent heartbeats of all running processes

    def __init__(self) -> None:
        self._limits = LabelSets(SAMPLES_MAX), LabelSets(STAGES_MAX), LabelSets(CAMERAS_MAX)
        self._sample_sets, self._stage_sets, self._camera_sets = self._limits

    def add_message(self, message: Message) -> None:  # noqa: B027  # most need paths only
        """Add a message of the system."""

    @abstractmethod
    def add_frame_path(self, path: FramePath) -> None:
        """Add the path of a frame."""

    @abstractmethod
    def close(self) -> None:
        """Send the remaining values, and stop."""

    def samples(self, *names: str) -> Iterator[Sample]:
        """Yield the values of measures."""
        for sample in samples(self.healths):
            if sample.name in names and self._sample_sets.admits(
                sample.name, *sample.labels.values()
            ):
                yield sample
        if "left_out" in names:
            yield Sample("left_out", sum(limit.left_out for limit in self._limits), {})


def samples(healths: Iterable[Health]) -> Iterator[Sample]:
    """Yield all values of heartbeats."""
    healths = list(healths)
    for health in healths:
        yield from _of_process(health)
    for host, clock in clocks_of(healths).items():
        yield Sample("clock_offset", clock.offset_ns / 1e9, {"host": host})
        yield Sample("clock_error", clock.error_ns / 1e9, {"host": host})


def _of_process(health: Health) -> Iterator[Sample]:
    labels = {"service": health.service, "instance": health.instance, "host": health.host}
    for state in get_args(State):
        yield Sample("state", float(health.state == state), labels | {"state": state})
    for prefix, direction in (("received_", "in"), ("sent_", "out")):
        for name, count in health.counters.items():
            if name.startswith(prefix):
                topic = name.removeprefix(prefix)
                yield Sample("messages", count, labels | {"direction": direction, "topic": topic})
    for cause, count in losses(health.counters).items():
        yield Sample("losses", count, labels | {"cause": cause})
    gauges = health.gauges
    for name, value in gauges.items():
        if name.startswith("age_"):
            topic = name.removeprefix("age_").removesuffix("_ms")
            yield Sample("input_age", value / 1e3, labels | {"topic": topic})
    if "cpu_percent" in gauges:
        yield Sample("cpu", gauges["cpu_percent"] / 100, labels)
    if "memory_mb" in gauges:
        yield Sample("memory", gauges["memory_mb"] * 2**20, labels)
