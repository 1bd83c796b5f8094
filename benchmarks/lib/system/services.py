"""The services as processes, without a supervisor, for measurements."""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from common.transport.ports import free_port
from common.transport.trace import JOINED
from people4d.client import Client
from people4d.messages import Health

STARTS = ("services.router.__main__", "deploy.joined")
READY_S = 120.0
CONNECT_S = 20.0


class Cluster:
    """A router and processes that are started one by one."""

    def __init__(self, logs: Path) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self._processes: list[subprocess.Popen[bytes]] = []
        self._logs = logs
        self._state = tempfile.TemporaryDirectory()  # separate state of each run
        self.start("router", "router", ())

    def start(self, service: str, instance: str, settings: Sequence[str]) -> None:
        """Start a process.

        Args:
            service: Its service; several, with + between, in one process.
            instance: Its name; several, with + between.
            settings: "field=value" of its configuration; "service.field=value" of several.
        """
        flags = [flag for setting in settings for flag in ("--set", setting)]
        several = JOINED in service
        module = ["deploy.joined", *service.split(JOINED)] if several else [f"services.{service}"]
        command = [sys.executable, "-m", *module, "--instance", instance, *flags]
        environment = dict(os.environ, OMP_NUM_THREADS="1", PEOPLE4D_CONNECT=self.endpoint)
        environment["PEOPLE4D_STATE"] = self._state.name
        listen = {"PEOPLE4D_LISTEN": self.endpoint} if service == "router" else {}
        with (self._logs / f"{instance}.log").open("wb") as log:
            self._processes.append(
                subprocess.Popen(command, stdout=log, stderr=log, env=environment | listen)
            )

    def wait_ready(self, client: Client, instances: set[str]) -> None:
        """Wait until these processes report that they work; TimeoutError if one does not."""
        waiting = set(instances)
        for health in client.messages(Health, timeout_s=READY_S):
            if health.state in ("ready", "degraded"):
                waiting.discard(health.instance)
            if not waiting:
                return
        raise TimeoutError(f"not ready: {', '.join(sorted(waiting))}; see {self._logs}")

    def close(self) -> None:
        """End all processes, last started first."""
        for process in reversed(self._processes):
            process.send_signal(signal.SIGTERM)
        for process in self._processes:
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._state.cleanup()


@contextlib.contextmanager
def running(
    services: Sequence[tuple[str, Sequence[str]]], logs: Path, together: bool = False
) -> Iterator[Client]:
    """Run services until the block ends.

    Args:
        services: Name and settings ("field=value") of each, without the router. A repeated name
            gives several processes. The last service starts when the others are ready.
        logs: Folder of their output.
        together: True: one process for all services.

    Yields:
        A client of the system, connected before the last service starts.
    """
    if together:
        settings: Sequence[str] = [f"{name}.{text}" for name, texts in services for text in texts]
        services = [(JOINED.join(name for name, _ in services), settings)]
    names = [name for name, _ in services]
    instances = [
        JOINED.join(f"{one}-{names[: k + 1].count(name)}" for one in name.split(JOINED))
        for k, name in enumerate(names)
    ]
    with (
        contextlib.closing(Cluster(logs)) as started,
        Client(started.endpoint, timeout_s=CONNECT_S) as client,
    ):
        for instance, (service, settings) in zip(instances[:-1], services[:-1], strict=True):
            started.start(service, instance, settings)
        started.wait_ready(client, set(instances[:-1]))
        started.start(names[-1], instances[-1], services[-1][1])
        yield client
