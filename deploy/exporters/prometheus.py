"""Latency and health for Prometheus."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, get_args

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from common.runtime.monitor import FramePath, clocks_of
from common.runtime.throughput import losses
from deploy.exporters.metrics_server import MetricsServer
from people4d.errors import People4dError
from people4d.messages import Health
from people4d.messages.status import State

# Labels come from messages, which any process may send without keys, and the library stores every
# set of labels. A robot has about a thousand sets.
SAMPLES_MAX, STAGES_MAX, CAMERAS_MAX = 4096, 512, 64
LENGTH_MAX = 128  # maximum length of a label [characters]
# Upper bounds of the buckets of durations [s]
BUCKETS_S = (1e-4, 2.5e-4, 5e-4, 1e-3, 2.5e-3, 5e-3, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)
STAGE = ("service", "instance", "stage")  # labels of a stage

# Types and descriptions of the metrics of heartbeats
METRICS: Mapping[str, tuple[type[CounterMetricFamily | GaugeMetricFamily], str]] = {
    "state": (GaugeMetricFamily, "1 for the state of a process, 0 for other states"),
    "messages": (CounterMetricFamily, "Received (in) and sent (out) messages by topic"),
    "losses": (CounterMetricFamily, "Lost messages and errors by cause"),
    "input_age_seconds": (GaugeMetricFamily, "Age of the newest message of a topic"),
    "cpu": (GaugeMetricFamily, "CPU time of a process as a share of one core"),
    "memory_bytes": (GaugeMetricFamily, "Resident memory of a process"),
    "clock_offset_seconds": (GaugeMetricFamily, "Clock of a host less clock of the router"),
    "clock_error_seconds": (GaugeMetricFamily, "Bound of the error of clock_offset"),
    "left_out": (CounterMetricFamily, "Omitted values: too many labels, or too long ones"),
}

Sample = tuple[str, float, Mapping[str, str]]  # key of METRICS, value, labels


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


class PrometheusExporter(Collector):
    """Serves /metrics.

    Raises:
        People4dError: The server cannot listen at the address.
    """

    def __init__(self, address: str, port: int) -> None:
        self.healths: Sequence[Health] = ()  # recent heartbeats of all running processes
        self._limits = LabelSets(SAMPLES_MAX), LabelSets(STAGES_MAX), LabelSets(CAMERAS_MAX)
        registry = CollectorRegistry()
        buckets: dict[str, Any] = {"buckets": BUCKETS_S, "registry": registry}
        text = "Time of a frame in one stage of one process"
        self._stages = Histogram("people4d_stage_seconds", text, STAGE, **buckets)
        text = "Frames with a negative duration: the clocks of two hosts disagree"
        self._negative = Counter("people4d_stage_negative", text, STAGE, registry=registry)
        text = "Time from the first stage of a frame to the arrival of its people"
        self._end_to_end = Histogram("people4d_latency_seconds", text, ("camera",), **buckets)
        text = "Confirmed people in the last message"
        self._people = Gauge("people4d_people", text, ("camera",), registry=registry)
        registry.register(self)
        try:
            self._server = MetricsServer(address, port, registry)
        except OSError as error:
            raise People4dError(
                f"nothing can listen at {address}:{port}: {error.strerror}",
                "Take another port with --prometheus.",
            ) from error

    @property
    def port(self) -> int:
        """Port of the server."""
        return self._server.port

    def add_frame_path(self, path: FramePath) -> None:
        """Add the path of a frame."""
        _, stages, cameras = self._limits
        for part in path.stages:
            labels = (part.service, part.instance, part.stage)
            if not stages.admits(*labels):
                continue
            if part.ms < 0:
                self._negative.labels(*labels).inc()
            else:
                self._stages.labels(*labels).observe(part.ms / 1e3)
        camera = path.tracks.camera
        if not cameras.admits(camera):
            return
        self._end_to_end.labels(camera).observe(path.end_to_end.ms / 1e3)
        confirmed = sum(person.state == "confirmed" for person in path.tracks.tracks)
        self._people.labels(camera).set(confirmed)

    def close(self) -> None:
        """Stop the server."""
        self._server.close()

    def collect(self) -> Iterator[Metric]:
        """Yield each metric of heartbeats that has a value."""
        limit, *_ = self._limits
        found = [one for one in samples(self.healths) if limit.admits(one[0], *one[2].values())]
        found.append(("left_out", sum(limit.left_out for limit in self._limits), {}))
        found.sort(key=lambda sample: sample[0])
        for name, group in groupby(found, lambda sample: sample[0]):
            family, text = METRICS[name]
            values = list(group)
            metric = family(f"people4d_{name}", text, labels=list(values[0][2]))
            for _, value, labels in values:
                metric.add_metric(list(labels.values()), value)
            yield metric


def samples(healths: Iterable[Health]) -> Iterator[Sample]:
    """Yield all values of heartbeats, with the same labels for all values of a metric."""
    healths = list(healths)
    for health in healths:
        yield from _of_process(health)
    for host, clock in clocks_of(healths).items():
        yield "clock_offset_seconds", clock.offset_ns / 1e9, {"host": host}
        yield "clock_error_seconds", clock.error_ns / 1e9, {"host": host}


def _of_process(health: Health) -> Iterator[Sample]:
    process = {"service": health.service, "instance": health.instance, "host": health.host}
    for state in get_args(State):
        yield "state", float(health.state == state), process | {"state": state}
    for prefix, direction in (("received_", "in"), ("sent_", "out")):
        for name, count in health.counters.items():
            if name.startswith(prefix):
                topic = name.removeprefix(prefix)
                yield "messages", count, process | {"direction": direction, "topic": topic}
    for cause, count in losses(health.counters).items():
        yield "losses", count, process | {"cause": cause}
    gauges = health.gauges
    for name, value in gauges.items():
        if name.startswith("age_"):
            topic = name.removeprefix("age_").removesuffix("_ms")
            yield "input_age_seconds", value / 1e3, process | {"topic": topic}
    if "cpu_percent" in gauges:
        yield "cpu", gauges["cpu_percent"] / 100, process
    if "memory_mb" in gauges:
        yield "memory_bytes", gauges["memory_mb"] * 2**20, process
