"""Metrics for Prometheus and traces for OpenTelemetry, read by their own libraries."""

import socket
import threading
import time
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any, ClassVar

import msgspec
import pytest
from opentelemetry.sdk.metrics.export import InMemoryMetricReader
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from prometheus_client.parser import text_string_to_metric_families
from typer.testing import CliRunner

from common.runtime.latency import end_to_end, segments
from common.runtime.monitor import FramePath, clocks_of
from common.transport.clock import HostOffset
from deploy.cli import app
from deploy.cli.live.export import feed, otlp_exporter
from deploy.exporters.measures import CAMERAS_MAX, SAMPLES_MAX, STAGES_MAX, Exporter
from deploy.exporters.metrics_server import CONNECTIONS_MAX
from deploy.exporters.otel import OtelExporter
from deploy.exporters.prometheus import PrometheusExporter
from people4d.client import Client
from people4d.errors import People4dError
from people4d.messages import Span
from tests.deploy.cli.test_top import talking
from tests.deploy.traces import BEGIN_NS, MS, healths, span, trace_of, tracks
from tests.network import WAIT_S, Network

pytestmark = pytest.mark.network

__all__ = ["talking"]  # a fixture


def give(exporter: Exporter, frames: int) -> None:
    """Pass heartbeats and frames of a system on two hosts to an exporter."""
    exporter.healths = healths()
    clocks = clocks_of(healths())
    for number in range(frames):
        exporter.add_frame_path(path(number, trace_of(number), clocks))


def path(number: int, trace: Sequence[Span], clocks: Mapping[str, HostOffset]) -> FramePath:
    """Return the path of a frame with 5 ms of parallel work on its people."""
    total = end_to_end(trace, clocks)
    assert total is not None
    parallel = segments(
        [span("detector.locate", 20 * number + 36, 20 * number + 41, "detector-1@nuc")]
    )
    return FramePath(tracks(number), segments(trace, clocks), parallel, total)


def fetched(exporter: PrometheusExporter) -> dict[tuple[str, frozenset[str]], float]:
    """Return what /metrics serves: values by name and labels, which all name the robot."""
    url = f"http://127.0.0.1:{exporter.port}/metrics"
    with urllib.request.urlopen(url, timeout=WAIT_S) as answer:
        families = text_string_to_metric_families(answer.read().decode())
        samples = [sample for family in families for sample in family.samples]
    assert {sample.labels.pop("robot") for sample in samples} == {"robby"}
    return {
        (sample.name, frozenset(f"{k}={v}" for k, v in sample.labels.items())): sample.value
        for sample in samples
    }


@pytest.fixture
def prometheus() -> Iterator[PrometheusExporter]:
    with closing(PrometheusExporter("robby", "127.0.0.1", 0)) as exporter:
        yield exporter


def test_prometheus_metrics_match_hand_worked_values(prometheus: PrometheusExporter) -> None:
    give(prometheus, 4)
    got = fetched(prometheus)

    def of(name: str, *labels: str) -> float:
        return got[f"people4d_{name}", frozenset(labels)]

    inference = ("service=detector", "instance=detector-1", "stage=inference")
    assert of("stage_seconds_count", *inference) == 2  # frames 0 and 2
    assert of("stage_seconds_sum", *inference) == pytest.approx(0.060)
    assert of("stage_seconds_bucket", *inference, "le=0.025") == 0
    assert of("stage_seconds_bucket", *inference, "le=0.05") == 2
    locate = ("service=detector", "instance=detector-1", "stage=locate")
    assert of("stage_seconds_sum", *locate) == pytest.approx(4 * 0.005)
    assert of("latency_seconds_sum", "camera=front") == pytest.approx(4 * 0.045)
    detector = ("service=detector", "instance=detector-1", "host=nuc")
    assert of("messages_total", *detector, "direction=in", "topic=frames") == 100
    assert of("losses_total", *detector, "cause=dropped_frames") == 10
    assert of("input_age_seconds", *detector, "topic=frames") == pytest.approx(0.012)
    assert of("cpu", *detector) == pytest.approx(0.83)
    assert of("memory_bytes", *detector) == 128 * 2**20
    reid = ("service=reid", "instance=reid-1", "host=brain")
    assert (of("state", *reid, "state=degraded"), of("state", *reid, "state=ready")) == (1, 0)
    assert of("clock_offset_seconds", "host=brain") == pytest.approx(0.25)
    assert of("clock_error_seconds", "host=brain") == pytest.approx(0.0005)
    assert of("people", "camera=front") == 1


def test_metrics_of_a_stopped_process_are_removed(prometheus: PrometheusExporter) -> None:
    give(prometheus, 1)
    prometheus.healths = healths()[:1]
    memory = [labels for name, labels in fetched(prometheus) if name == "people4d_memory_bytes"]
    assert memory == [frozenset({"service=detector", "instance=detector-1", "host=nuc"})]


def test_negative_durations_are_counted(prometheus: PrometheusExporter) -> None:
    # A tracker host whose clock is 250 ms behind, and not compared.
    behind = [s for s in trace_of(0) if "tracker" not in s.stage]
    behind += [s for s in trace_of(-25) if "tracker" in s.stage]
    prometheus.add_frame_path(path(0, behind, {}))
    labels = frozenset({"service=tracker", "instance=tracker-1", "stage=transport"})
    got = fetched(prometheus)
    assert got["people4d_stage_negative_total", labels] == 1
    assert ("people4d_stage_seconds_count", labels) not in got


def forge(exporter: Exporter, number: int) -> None:
    """Give an exporter heartbeats and a frame with unused names."""
    health = healths()[0]
    counters = {f"received_{number}_{k}": 1 for k in range(50)} | {
        f"bad_{number}_{k}": 1 for k in range(50)
    }
    names = {"instance": f"detector-{number}", "host": f"host{number}"}
    exporter.healths = [*healths(), msgspec.structs.replace(health, counters=counters, **names)]
    forged = [span(f"s{number}.x{k}", 0, 1, f"p{k}@{number}") for k in range(20)]
    frame = path(number, forged, {})
    camera = msgspec.structs.replace(frame.tracks, camera=f"camera{number}")
    exporter.add_frame_path(replace(frame, tracks=camera))


def test_invented_names_are_bounded_and_counted_for_prometheus(
    prometheus: PrometheusExporter,
) -> None:
    give(prometheus, 4)
    got = fetched(prometheus)
    for number in range(200):
        forge(prometheus, number)
        if number % 40 == 39:
            got = fetched(prometheus)
    assert len(got) < SAMPLES_MAX + 18 * (STAGES_MAX + CAMERAS_MAX) + 10
    assert got["people4d_left_out_total", frozenset()] > 500
    assert got["people4d_latency_seconds_count", frozenset({"camera=front"})] == 4
    assert (
        "people4d_cpu",
        frozenset({"service=detector", "instance=detector-1", "host=nuc"}),
    ) in got


def test_invented_names_are_bounded_and_counted_for_opentelemetry() -> None:
    metrics = InMemoryMetricReader()
    exporter = OtelExporter("robot", SimpleSpanProcessor(InMemorySpanExporter()), metrics)
    data = None
    for number in range(200):
        forge(exporter, number)
        if number % 40 == 39:
            data = metrics.get_metrics_data()
    exporter.close()
    assert data is not None
    points: dict[str, list[Any]] = {
        metric.name: list(metric.data.data_points)
        for metric in data.resource_metrics[0].scope_metrics[0].metrics
    }
    assert sum(map(len, points.values())) <= SAMPLES_MAX + STAGES_MAX + CAMERAS_MAX + 1
    assert points["people4d.left_out"][0].value > 500


def test_long_name_is_left_out(prometheus: PrometheusExporter) -> None:
    health = healths()[0]
    prometheus.healths = [msgspec.structs.replace(health, host="x" * 60_000)]
    got = fetched(prometheus)
    assert {name for name, _ in got} == {"people4d_left_out_total"}


def test_metrics_are_served_beside_many_connections_that_ask_nothing(
    prometheus: PrometheusExporter,
) -> None:
    threads = threading.active_count()
    with ExitStack() as stack:
        for _ in range(200):
            address = ("127.0.0.1", prometheus.port)
            one = stack.enter_context(socket.create_connection(address, WAIT_S))
            one.sendall(b"GET /met")
        assert fetched(prometheus) is not None
        assert threading.active_count() < threads + 2 * CONNECTIONS_MAX


def test_taken_port_is_reported(prometheus: PrometheusExporter) -> None:
    with pytest.raises(People4dError, match=r"nothing can listen at .*Take another port"):
        PrometheusExporter("robby", "127.0.0.1", prometheus.port)


def test_opentelemetry_spans_match_hand_worked_values() -> None:
    spans, metrics = InMemorySpanExporter(), InMemoryMetricReader()
    exporter = OtelExporter("robot", SimpleSpanProcessor(spans), metrics)
    give(exporter, 1)
    finished = spans.get_finished_spans()
    by_name = {one.name: one for one in finished}
    frame = by_name["frame"]
    assert frame.context is not None
    assert (frame.start_time, frame.end_time) == (BEGIN_NS, BEGIN_NS + 45 * MS)
    assert frame.attributes is not None
    assert frame.attributes["people4d.clock_error_ms"] == 0.5
    # 10 measured, 2 between processes, 1 parallel; all below the frame.
    children = [one for one in finished if one.parent is not None]
    assert len(children) == 13
    assert {child.parent.span_id for child in children if child.parent} == {frame.context.span_id}
    ride = by_name["tracker.transport"]
    assert (ride.start_time, ride.end_time) == (BEGIN_NS + 37 * MS, BEGIN_NS + 40 * MS)
    assert dict(by_name["tracker.association"].resource.attributes) == {
        "service.name": "tracker",
        "service.namespace": "robot",
        "service.instance.id": "tracker-1",
        "host.name": "brain",
    }
    data = metrics.get_metrics_data()
    assert data is not None
    points: dict[str, list[Any]] = {
        metric.name: list(metric.data.data_points)
        for metric in data.resource_metrics[0].scope_metrics[0].metrics
    }
    assert {"people4d.stage.duration", "people4d.latency", "people4d.losses"} <= set(points)
    (latency,) = points["people4d.latency"]
    assert latency.sum == pytest.approx(0.045)
    (offset,) = [p for p in points["people4d.clock_offset"] if p.attributes["host"] == "brain"]
    assert offset.value == pytest.approx(0.25)
    exporter.close()


class Collector(BaseHTTPRequestHandler):
    """Receives OTLP over HTTP, and stores the paths."""

    paths: ClassVar[list[str]] = []

    def do_POST(self) -> None:
        self.paths.append(self.path)
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(200)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Be silent."""


def test_otlp_is_flushed_at_the_end() -> None:
    server = HTTPServer(("127.0.0.1", 0), Collector)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        exporter = otlp_exporter("robot", f"http://127.0.0.1:{server.server_port}/")
        give(exporter, 2)
        exporter.close()
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
    assert set(Collector.paths) == {"/v1/traces", "/v1/metrics"}


def test_metrics_of_a_running_system_are_served(
    network: Network, talking: str, prometheus: PrometheusExporter
) -> None:
    client = Client(network.endpoint, talking)
    thread = threading.Thread(target=feed, args=(client, [prometheus]), daemon=True)
    thread.start()
    key = ("people4d_latency_seconds_count", frozenset({"camera=front"}))
    end_s = time.monotonic() + WAIT_S
    while not (count := fetched(prometheus).get(key, 0)) and time.monotonic() < end_s:
        thread.join(0.05)
    client.close()
    assert count > 0


def test_export_without_a_target_is_rejected() -> None:
    result = CliRunner().invoke(app, ["export"])
    assert result.exit_code == 2
    assert "--prometheus PORT, --otlp URL or --mqtt URL" in result.stderr
