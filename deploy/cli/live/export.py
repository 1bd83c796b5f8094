"""people4d export."""

import os
import socket
import time
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Annotated

import typer

from common.extras import need
from common.runtime.monitor import Monitor
from common.transport.trace import ProcessId
from deploy.cli.options import Connect, Robot, open_client
from deploy.cli.terminal import signals_interrupt
from people4d.client import Client
from people4d.messages import Health

if TYPE_CHECKING:
    from deploy.exporters.prometheus import PrometheusExporter

WINDOW_S = 10.0  # window of latencies [s]


def export(
    prometheus: Annotated[
        int, typer.Option(metavar="PORT", min=0, max=65535, help="Serve /metrics on this port.")
    ],
    address: Annotated[str, typer.Option(help="Address of the server.")] = "127.0.0.1",
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Export latency of every stage and health of every process to Prometheus.

    Runs until Ctrl-C, and needs the extra prometheus.
    """
    need("Prometheus", "prometheus")
    from deploy.exporters.prometheus import PrometheusExporter  # noqa: PLC0415 (optional)

    with (
        open_client(connect, robot) as client,
        closing(PrometheusExporter(address, prometheus)) as exporter,
        suppress(KeyboardInterrupt),
        signals_interrupt(),
    ):
        typer.echo(f"Serving http://{address}:{exporter.port}/metrics; Ctrl-C ends it.")
        feed(client, exporter)


def feed(client: Client, exporter: "PrometheusExporter") -> None:
    """Give an exporter frames and heartbeats, until interrupted."""
    monitor = Monitor(ProcessId("export", f"export-{os.getpid()}", socket.gethostname()), WINDOW_S)
    for arrival, path in monitor.follow(client):
        if path:
            exporter.add_frame_path(path)
        elif isinstance(arrival.message, Health):
            exporter.healths = monitor.healths(time.monotonic())
