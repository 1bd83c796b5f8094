"""Latency and health for Prometheus."""

from collections.abc import Iterator
from itertools import groupby

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from common.runtime.monitor import FramePath
from deploy.exporters.measures import (
    BUCKETS_S,
    LATENCY_TEXT,
    MEASURES,
    STAGE_TEXT,
    Exporter,
    Sample,
)
from deploy.exporters.metrics_server import MetricsServer
from people4d.errors import People4dError

UNITS = {"s": "_seconds", "By": "_bytes", "1": ""}
ROBOT = "robot"
PIECE = (ROBOT, "service", "instance", "stage")


class PrometheusExporter(Exporter, Collector):
    """Serves /metrics with the robot in the labels; People4dError if it cannot listen."""

    def __init__(self, robot: str, address: str, port: int) -> None:
        super().__init__()
        self._robot = robot
        registry = CollectorRegistry()
        self._stages = Histogram(
            "people4d_stage_seconds", STAGE_TEXT, PIECE, buckets=BUCKETS_S, registry=registry
        )
        self._negative = Counter(
            "people4d_stage_negative",
            "Frames with a negative duration: the clocks of two hosts disagree",
            PIECE,
            registry=registry,
        )
        self._end_to_end = Histogram(
            "people4d_latency_seconds",
            LATENCY_TEXT,
            (ROBOT, "camera"),
            buckets=BUCKETS_S,
            registry=registry,
        )
        text = "Confirmed people in the last message"
        self._people = Gauge("people4d_people", text, (ROBOT, "camera"), registry=registry)
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
        for part in path.stages:
            labels = (self._robot, part.service, part.instance, part.stage)
            if not self._stage_sets.admits(*labels):
                continue
            if part.ms < 0:
                self._negative.labels(*labels).inc()
            else:
                self._stages.labels(*labels).observe(part.ms / 1e3)
        camera = path.tracks.camera
        if not self._camera_sets.admits(camera):
            return
        self._end_to_end.labels(self._robot, camera).observe(path.end_to_end.ms / 1e3)
        confirmed = sum(person.state == "confirmed" for person in path.tracks.tracks)
        self._people.labels(self._robot, camera).set(confirmed)

    def close(self) -> None:
        """Send the remaining values, and stop."""
        self._server.close()

    def collect(self) -> Iterator[Metric]:
        """Yield a metric for each measure with a value."""
        found = sorted(self.samples(*MEASURES), key=lambda sample: sample.name)
        for name, group in groupby(found, lambda sample: sample.name):
            yield _metric(name, list(group), self._robot)


def _metric(name: str, values: list[Sample], robot: str) -> Metric:
    measure, labels = MEASURES[name], list(values[0].labels)
    full = f"people4d_{name}{UNITS[measure.unit]}"
    kind = CounterMetricFamily if measure.kind == "counter" else GaugeMetricFamily
    metric = kind(full, measure.text, labels=[ROBOT, *labels])
    for sample in values:
        metric.add_metric([robot, *(sample.labels[label] for label in labels)], sample.value)
    return metric
