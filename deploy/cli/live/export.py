"""Command `people4d export`."""

import os
import socket
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing, suppress
from typing import Annotated

import typer

from common.extras import need
from common.runtime.monitor import Monitor
from common.transport.trace import ProcessId
from deploy.cli.options import Connect, Robot, open_client
from deploy.cli.terminal import signals_interrupt
from deploy.exporters.measures import Exporter
from deploy.exporters.mqtt import MqttExporter
from people4d.client import Client
from people4d.messages import Health, Zones

WINDOW_S = 10.0
METRICS_S = 10.0


def export(
    prometheus: Annotated[
        int | None,
        typer.Option(metavar="PORT", min=0, max=65535, help="Serve /metrics on this port."),
    ] = None,
    address: Annotated[str, typer.Option(help="Address of the server.")] = "127.0.0.1",
    otlp: Annotated[
        str,
        typer.Option(
            metavar="URL", help="Send to an OpenTelemetry collector, e.g. http://localhost:4318."
        ),
    ] = "",
    mqtt: Annotated[
        str,
        typer.Option(
            metavar="URL", help="Send people and zones to a broker, e.g. mqtt://localhost."
        ),
    ] = "",
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Export latency and health to Prometheus or OpenTelemetry, people and zones to MQTT.

    Runs until Ctrl-C. The extras are prometheus, otel and mqtt.
    """
    if prometheus is None and not otlp and not mqtt:
        raise typer.BadParameter("name --prometheus PORT, --otlp URL or --mqtt URL")
    if prometheus is not None:
        need("Prometheus", "prometheus")
    if otlp:
        need("OpenTelemetry", "otel")
    if mqtt:
        need("MQTT", "mqtt")
    with (
        open_client(connect, robot) as client,
        ExitStack() as exporters,
        suppress(KeyboardInterrupt),
        signals_interrupt(),
    ):
        used: list[Exporter] = []
        if prometheus is not None:
            used.append(
                exporters.enter_context(closing(prometheus_exporter(robot, address, prometheus)))
            )
        if otlp:
            used.append(exporters.enter_context(closing(otlp_exporter(robot, otlp))))
        if mqtt:
            used.append(exporters.enter_context(closing(mqtt_exporter(robot, mqtt))))
        feed(client, used)


def feed(client: Client, exporters: Sequence[Exporter]) -> None:
    """Pass messages to exporters until interrupted."""
    monitor = Monitor(ProcessId("export", f"export-{os.getpid()}", socket.gethostname()), WINDOW_S)
    for arrival, path in monitor.follow(client, Zones):
        for exporter in exporters:
            exporter.add_message(arrival.message)
            if path:
                exporter.add_frame_path(path)
            elif isinstance(arrival.message, Health):
                exporter.healths = monitor.healths(time.monotonic())


def prometheus_exporter(robot: str, address: str, port: int) -> Exporter:
    """Return the exporter for Prometheus."""
    from deploy.exporters.prometheus import PrometheusExporter  # noqa: PLC0415 (optional)

    exporter = PrometheusExporter(robot, address, port)
    typer.echo(f"Serving http://{address}:{exporter.port}/metrics; Ctrl-C ends it.")
    return exporter


def mqtt_exporter(robot: str, url: str) -> Exporter:
    """Return the exporter for MQTT."""
    exporter = MqttExporter(robot, url)
    typer.echo(f"Sending to {exporter.topic}/ of the broker; Ctrl-C ends it.")
    return exporter


def otlp_exporter(robot: str, url: str) -> Exporter:
    """Return the exporter that sends to a collector by OTLP over HTTP."""
    from opentelemetry.exporter.otlp.proto.http.metric_exporter import OTLPMetricExporter  # noqa: PLC0415
    from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter  # noqa: PLC0415
    from opentelemetry.sdk.metrics.export import PeriodicExportingMetricReader  # noqa: PLC0415
    from opentelemetry.sdk.trace.export import BatchSpanProcessor  # noqa: PLC0415

    from deploy.exporters.otel import OtelExporter  # noqa: PLC0415

    base = url.rstrip("/")
    typer.echo(f"Sending to {base}/v1/traces and /v1/metrics; Ctrl-C ends it.")
    return OtelExporter(
        robot,
        BatchSpanProcessor(OTLPSpanExporter(f"{base}/v1/traces")),
        PeriodicExportingMetricReader(
            OTLPMetricExporter(f"{base}/v1/metrics"), export_interval_millis=METRICS_S * 1e3
        ),
    )
