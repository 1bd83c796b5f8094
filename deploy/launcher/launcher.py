"""Starts a system in the order of its dependencies, watches it, and stops it."""

import contextlib
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from deploy.compose import Dependency, Service
from deploy.launcher.health import Heartbeats, check_of
from deploy.launcher.state import Run, State
from deploy.launcher.supervisor import Process, Supervisor, SupervisorGoneError
from people4d.errors import People4dError

POLL_S = 0.1
STOP_TIMEOUT_S = 120.0
QUIET_S = 2.0
# What comes from frames. Health never rests, and predictions go on after the last frame.
FROM_FRAMES = ("received_frames", "received_detections", "received_crops", "received_embeddings")
TAIL_LINES = 12
WATCHDOG = "watchdog"

Progress = Callable[[str, str], None]


class LaunchError(People4dError):
    """A service does not come up or does not stay up; carries the end of its log."""

    def __init__(self, problem: str, hint: str, tail: str) -> None:
        super().__init__(problem, hint)
        self.tail = tail


class Launcher:
    """One system on this machine.

    Args:
        state: Its folder.
        services: What shall run, in an order in which it can be started.
        heartbeats: Where its services tell how they are.
        progress: Told of each change: name of the service or process, what happened.
    """

    def __init__(
        self,
        state: State,
        services: Sequence[Service],
        heartbeats: Heartbeats,
        progress: Progress,
    ) -> None:
        self.state = state
        self.services = services
        self.heartbeats = heartbeats
        self.supervisor = Supervisor(state)
        self._progress = progress
        self._by_name = {service.name: service for service in services}
        self._never_again = {
            name for service in services if service.restart == "no" for name in service.instances
        }
        self._checks = {service.name: check_of(service, heartbeats) for service in services}
        self._started_s: dict[str, float] = {}
        self._reached: dict[str, str] = {}
        self._pids: dict[str, int] = {}
        self._restarted: set[str] = set()
        self._finished: set[str] = set()

    def start(self, robot: str, connect: str, timeout_s: float) -> None:
        """Start every service once those it waits for are healthy.

        Args:
            robot: Name of the robot, to be noted.
            connect: Endpoint of the router, to be noted.
            timeout_s: Longest time from a service's start until it is healthy.

        Raises:
            LaunchError: A service fails or is not healthy in time; everything is stopped again.
            People4dError: The system runs already.
        """
        running = self.state.read()
        if running:
            raise People4dError(
                f"people4d runs already for {robot} (supervisord has process number {running.pid})",
                "Stop it with people4d down, or name another robot with --robot and --port.",
            )
        swept = self.state.sweep()
        self.state.prepare()
        if swept:
            self._progress("left over", f"{swept} processes of a killed run ended")
        names = tuple(service.name for service in self.services)
        pid = self.supervisor.spawn(self.services)
        self.state.plan_file.write_bytes(msgspec.json.encode(self.services))
        self.state.write(Run(robot=robot, connect=connect, services=names, pid=pid))
        try:
            self._start_services(timeout_s)
        except BaseException:
            stop(self.state)
            raise
        finally:
            for check in self._checks.values():
                check.close()

    def _start_services(self, timeout_s: float) -> None:
        while len(self._reached) < len(self.services):
            for service in self.services:
                if service.name not in self._started_s and all(map(self._met, service.depends_on)):
                    self._started_s[service.name] = time.monotonic()
                    for instance in service.instances:
                        self.supervisor.start(instance)
            processes = self.processes()
            for name in self._started_s:
                self._follow(self._by_name[name], processes, timeout_s)
            time.sleep(POLL_S)

    def _met(self, dependency: Dependency) -> bool:
        reached = self._reached.get(dependency.service)
        if dependency.condition == "service_started":
            return dependency.service in self._started_s
        if dependency.condition == "service_completed_successfully":
            return reached == "finished"
        return reached is not None

    def _follow(
        self, service: Service, all_processes: dict[str, Process], timeout_s: float
    ) -> None:
        """Note how far a started service has come."""
        if self._reached.get(service.name) == "finished":
            return
        processes = [all_processes[name] for name in service.instances]
        if service.name not in self._reached:
            self._check_first_start(processes)
        elapsed_s = time.monotonic() - self._started_s[service.name]
        if all(process.finished for process in processes):
            self._reached[service.name] = "finished"
        elif service.name not in self._reached and self._checks[service.name].healthy(processes):
            self._reached[service.name] = "healthy"
            self._progress(service.name, f"ready after {elapsed_s:.1f} s")
        elif service.name not in self._reached and elapsed_s > timeout_s:
            raise self._late(processes, timeout_s)

    def _check_first_start(self, processes: list[Process]) -> None:
        """Give up at once: what ends before it was ever ready is set up wrongly."""
        for process in processes:
            if process.state == "BACKOFF" or process.name in self._restarted:
                raise self._failure(process.name, "ended before it was ready")

    def _late(self, processes: list[Process], timeout_s: float) -> LaunchError:
        late = processes[0]
        healths = {p.name: self.heartbeats.of_instance(p.name, p.pid) for p in processes}
        reason = "it runs, but sends no heartbeat" if late.pid else f"it is {late.state}"
        for process in processes:
            health = healths[process.name]
            if health and health.state not in ("ready", "degraded"):
                late, reason = process, f"it is {health.state}: {health.reason}"
        return self._failure(late.name, f"is not ready after {timeout_s:.0f} s; {reason}")

    def _failure(self, instance: str, problem: str) -> LaunchError:
        return LaunchError(
            f"{instance} {problem}",
            f"The whole log: {self.state.log_of(instance)}",
            tail(self.state.log_of(instance), TAIL_LINES),
        )

    def processes(self) -> dict[str, Process]:
        """Return all processes by name, and tell of those that ended or came back.

        Raises:
            LaunchError: A process failed and is not started again.
        """
        processes = self.supervisor.processes()
        for process in processes.values():
            if process.gave_up or (process.ended_badly and process.name in self._never_again):
                problem = process.problem or f"exit status {process.exit_status}"
                raise self._failure(process.name, f"failed: {problem}")
            if process.finished and process.name not in self._finished:
                self._finished.add(process.name)
                last = self.heartbeats.of_instance(process.name)
                why = f": {last.reason}" if last and last.reason else ""
                self._progress(process.name, f"finished{why}")
            before = self._pids.get(process.name, 0)
            if process.pid and before and process.pid != before:
                self._restarted.add(process.name)
                self._progress(process.name, f"{self._end_of(process.name)} and was started again")
            self._pids[process.name] = process.pid or before
        return processes

    def _end_of(self, instance: str) -> str:
        """Return how a process ended: it died, or it hung and was killed."""
        watchdog = self.heartbeats.of_instance(f"{WATCHDOG}-1")
        hung = re.search(
            rf"\b{re.escape(instance)} (hung \([^)]*\))", watchdog.reason if watchdog else ""
        )
        return hung[1] if hung else "ended"

    def wait_finished(self, service: str) -> None:
        """Wait until every process of a service has ended by itself.

        Raises:
            LaunchError: A process of the system failed.
        """
        instances = self._by_name[service].instances
        while True:
            processes = self.processes()
            if all(processes[name].finished for name in instances):
                return
            time.sleep(POLL_S)

    def drain(self, timeout_s: float) -> None:
        """Wait until no service receives any more of what comes from frames.

        Args:
            timeout_s: Longest wait.
        """
        deadline_s = time.monotonic() + timeout_s
        before, since_s = self._counts(), time.monotonic()
        while time.monotonic() < min(deadline_s, since_s + QUIET_S):
            self.heartbeats.wait(POLL_S)
            now = self._counts()
            if now != before:
                before, since_s = now, time.monotonic()

    def _counts(self) -> dict[str, int]:
        return {
            f"{health.instance} {name}": health.counters[name]
            for health in self.heartbeats.all()
            for name in FROM_FRAMES
            if name in health.counters
        }


def stop(state: State) -> bool:
    """Stop a system, last started first, and whatever it left behind.

    Args:
        state: Its folder.

    Returns:
        Whether anything ran.
    """
    running = state.read()
    if running:
        with contextlib.suppress(SupervisorGoneError):  # it stops already
            Supervisor(state).shutdown()
        deadline_s = time.monotonic() + STOP_TIMEOUT_S
        while state.read() and time.monotonic() < deadline_s:
            time.sleep(POLL_S)
    swept = state.sweep()
    state.clear()
    return running is not None or swept > 0


def tail(file: Path, lines: int) -> str:
    """Return the last lines of a log, empty if there is none."""
    if lines < 1:
        return ""
    try:
        with file.open("rb") as log:
            log.seek(0, 2)
            log.seek(max(0, log.tell() - 512 * lines))
            text = log.read().decode(errors="replace")
    except OSError:
        return ""
    return "\n".join(text.splitlines()[-lines:])
