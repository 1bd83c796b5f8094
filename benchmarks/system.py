"""The services as processes, without a supervisor, for measurements."""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from common.client import Client
from common.messages import Health
from common.ports import free_port


@contextlib.contextmanager
def running(services: Sequence[tuple[str, Sequence[str]]], logs: Path) -> Iterator[Client]:
    """Run services until the block ends.

    Args:
        services: Name and settings ("field=value") of each; the router comes by itself. The last
            one is started when the others are ready.
        logs: Folder for what they print.

    Yields:
        A client of the system, connected before the last service starts.
    """
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    environment = dict(os.environ, OMP_NUM_THREADS="1", PEOPLE4D_CONNECT=endpoint)
    logs.mkdir(parents=True, exist_ok=True)
    processes: list[subprocess.Popen[bytes]] = []

    def start(service: str, settings: Sequence[str]) -> None:
        flags = [flag for setting in settings for flag in ("--set", setting)]
        command = [sys.executable, "-m", f"services.{service}", "--instance", service, *flags]
        listen = {"PEOPLE4D_LISTEN": endpoint} if service == "router" else {}
        with (logs / f"{service}.log").open("wb") as log:
            processes.append(
                subprocess.Popen(command, stdout=log, stderr=log, env=environment | listen)
            )

    try:
        start("router", ())
        with Client(endpoint, timeout_s=20) as client:
            for service, settings in services[:-1]:
                start(service, settings)
            _wait_ready(client, {service for service, _ in services[:-1]})
            start(*services[-1])
            yield client
    finally:
        for process in reversed(processes):
            process.send_signal(signal.SIGTERM)
        for process in processes:
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()


def _wait_ready(client: Client, services: set[str]) -> None:
    waiting = set(services)
    for health in client.messages(Health, timeout_s=30):
        if health.state in ("ready", "degraded"):
            waiting.discard(health.service)
        if not waiting:
            return
    raise TimeoutError(f"not ready: {', '.join(sorted(waiting))}")
