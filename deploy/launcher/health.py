"""Health of services as the launcher checks it."""

import socket
import subprocess
import threading
import time
from collections.abc import Sequence
from typing import Protocol

from deploy.compose import Healthcheck, Service
from deploy.launcher.supervisor import Process, local_command
from people4d.client import Client
from people4d.errors import People4dError
from people4d.messages import Health

FRESH_S = 3.0
CONNECT_TIMEOUT_S = 0.5
LONGEST_PAUSE_S = 1.0
BUILT_IN = ("people4d", "health")


class Heartbeats:
    """The last heartbeat of every process of a robot, received in a thread of its own.

    Args:
        connect: Endpoint of the router.
        robot: Name of the robot.
    """

    def __init__(self, connect: str, robot: str) -> None:
        self._connect = connect
        self._robot = robot
        self._client: Client | None = None
        self._thread: threading.Thread | None = None
        self._last: dict[tuple[str, str], tuple[float, Health]] = {}  # by host and instance
        self._arrived = threading.Condition()

    def connect(self, timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        """Begin to listen; does nothing if it listens already.

        Raises:
            People4dError: No router answers.
        """
        if self._client:
            return
        self._client = Client(self._connect, self._robot, timeout_s)
        self._thread = threading.Thread(target=self._listen, args=(self._client,), daemon=True)
        self._thread.start()

    def of_instance(self, instance: str, pid: int = 0) -> Health | None:
        """Return the fresh heartbeat of a process on this machine, None if there is none.

        Args:
            instance: Name of the process.
            pid: Its number; another process of that name does not count. 0: any.
        """
        return of_instance(self.all(), instance, pid)

    def all(self) -> list[Health]:
        """Return all fresh heartbeats."""
        oldest_s = time.monotonic() - FRESH_S
        return [health for when_s, health in list(self._last.values()) if when_s > oldest_s]

    def wait(self, timeout_s: float) -> bool:
        """Wait for the next heartbeat of any process; return whether one came."""
        with self._arrived:
            return self._arrived.wait(timeout_s)

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
    """Return the heartbeat of a process on this machine, None if there is none.

    Each machine has a watchdog-1, and in a container a machine has another name: a process of
    another machine counts only where none of that name runs here.

    Args:
        healths: All that came.
        instance: Name of the process.
        pid: Its number; another process of that name does not count. 0: any.
    """
    found = [h for h in healths if h.instance == instance and pid in (0, h.pid)]
    here = socket.gethostname()
    return min(found, key=lambda health: health.host != here, default=None)


def works(health: Health | None) -> bool:
    """Return whether a heartbeat tells of a process that does its work, if with limits."""
    return health is not None and health.state in ("ready", "degraded")


class Check(Protocol):
    """Tells whether the processes of one service are healthy."""

    def healthy(self, processes: Sequence[Process]) -> bool:
        """Return whether all of them are healthy; never waits long."""
        ...

    def close(self) -> None:
        """End what still runs; called once, when all is up or given up."""
        ...


class Running:
    """For a service without a health check: healthy while it runs."""

    def healthy(self, processes: Sequence[Process]) -> bool:
        """Return whether all processes run."""
        return all(process.state == "RUNNING" for process in processes)

    def close(self) -> None:
        """Hold nothing."""


class HeartbeatCheck:
    """Answers `people4d health` without a process of its own.

    Args:
        heartbeats: Where heartbeats come from.
    """

    def __init__(self, heartbeats: Heartbeats) -> None:
        self._heartbeats = heartbeats

    def healthy(self, processes: Sequence[Process]) -> bool:
        """Return whether each process tells that it works."""
        try:
            self._heartbeats.connect()
        except People4dError:
            return False
        return all(works(self._heartbeats.of_instance(p.name, p.pid)) for p in processes)

    def close(self) -> None:
        """Hold nothing; the heartbeats serve others too."""


class CommandCheck:
    """Runs the command of a health check again and again, in the background.

    Args:
        healthcheck: The command and its times.
    """

    def __init__(self, healthcheck: Healthcheck) -> None:
        self._healthcheck = healthcheck
        self._running: subprocess.Popen[bytes] | None = None
        self._due_s = self._deadline_s = 0.0

    def healthy(self, processes: Sequence[Process]) -> bool:
        """Return whether the command has just ended with 0."""
        now_s = time.monotonic()
        if self._running:
            if self._running.poll() is None and now_s < self._deadline_s:
                return False
            self._due_s = now_s + min(self._healthcheck.interval_s, LONGEST_PAUSE_S)
            return self._end() == 0
        if now_s >= self._due_s and Running().healthy(processes):
            self._deadline_s = now_s + self._healthcheck.timeout_s
            self._running = subprocess.Popen(
                local_command(self._healthcheck.test),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        return False

    def close(self) -> None:
        """End a check that still runs."""
        self._end()

    def _end(self) -> int | None:
        running, self._running = self._running, None
        if not running:
            return None
        running.kill()
        return running.wait()


def check_of(service: Service, heartbeats: Heartbeats) -> Check:
    """Return the check that a service's compose entry asks for."""
    if not service.healthcheck:
        return Running()
    if service.healthcheck.test[:2] == BUILT_IN:
        return HeartbeatCheck(heartbeats)
    return CommandCheck(service.healthcheck)
