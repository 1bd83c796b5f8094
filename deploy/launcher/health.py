"""Heartbeats of the processes of a robot, and the derived health of services."""

import socket
import threading
import time
from collections.abc import Sequence

from deploy.compose import Service
from deploy.launcher.supervisor import Process
from people4d.client import Client
from people4d.errors import People4dError
from people4d.messages import Health

FRESH_S = 3.0  # maximum age of a heartbeat [s]
CONNECT_TIMEOUT_S = 0.5  # maximum wait for the router [s]


class Heartbeats:
    """The last heartbeat of every process of a robot, received in a thread of its own."""

    def __init__(self, connect: str, robot: str) -> None:
        self._connect = connect
        self._robot = robot
        self._client: Client | None = None
        # Time and last heartbeat, by host and instance
        self._last: dict[tuple[str, str], tuple[float, Health]] = {}
        self._arrived = threading.Condition()

    def connect(self, timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        """Connect and listen, if not connected yet; People4dError if no router answers."""
        if not self._client:
            self._client = Client(self._connect, self._robot, timeout_s)
            threading.Thread(target=self._listen, args=(self._client,), daemon=True).start()

    def all(self) -> list[Health]:
        """Return all fresh heartbeats."""
        oldest_s = time.monotonic() - FRESH_S
        return [health for when_s, health in list(self._last.values()) if when_s > oldest_s]

    def wait(self, timeout_s: float) -> None:
        """Wait for the next heartbeat of any process."""
        with self._arrived:
            self._arrived.wait(timeout_s)

    def healthy(self, service: Service, processes: Sequence[Process]) -> bool:
        """Check that all processes of a service work, or run if it has no health check."""
        if not service.has_healthcheck:
            return all(process.state == "RUNNING" for process in processes)
        try:
            self.connect()
        except People4dError:
            return False
        healths = self.all()
        return all(works(of_instance(healths, p.name, p.pid)) for p in processes)

    def close(self) -> None:
        """Stop listening."""
        if self._client:
            self._client.close()

    def _listen(self, client: Client) -> None:
        for health in client.messages(Health):
            self._last[health.host, health.instance] = (time.monotonic(), health)
            with self._arrived:
                self._arrived.notify_all()


def of_instance(healths: Sequence[Health], instance: str, pid: int = 0) -> Health | None:
    """Return the heartbeat of a process, preferably on this host; None if there is none.

    Each host has a watchdog-1, and a container has another host name, so a process of another host
    counts only if no process of its name runs here. `pid` excludes other processes.
    """
    found = [h for h in healths if h.instance == instance and pid in (0, h.pid)]
    here = socket.gethostname()
    return min(found, key=lambda health: health.host != here, default=None)


def works(health: Health | None) -> bool:
    """Check that a process works, with or without limits."""
    return health is not None and health.state in ("ready", "degraded")
