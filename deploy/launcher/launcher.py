"""Starts a system in the order of its dependencies, watches it, scales it, and stops it."""

import contextlib
import re
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from common.text import listed
from deploy.compose import Dependency, Service
from deploy.launcher.health import Heartbeats, of_instance, works
from deploy.launcher.reasons import Reasons
from deploy.launcher.state import Run, State
from deploy.launcher.supervisor import Process, Supervisor, SupervisorGoneError
from people4d.errors import People4dError

POLL_S = 0.1
STOP_TIMEOUT_S = 120.0
STOP_S = 5.0  # maximum time to stop before a process is killed [s]
LONGEST_GRACE_S = 10.0  # maximum stop grace period of a service without files [s]
QUIET_S = 2.0  # minimum silence once all frames are processed [s]
# Counters of messages from frames. Health and predictions continue after the last frame.
FROM_FRAMES = ("received_frames", "received_detections", "received_crops", "received_embeddings")
TAIL_LINES = 12
WATCHDOG = "watchdog"
FAILURE = "failure.log"  # file with the failure of the last run, in the state folder

Progress = Callable[[str, str], None]  # reports the name of a service or process, and an event


class LaunchError(People4dError):
    """A service does not start or does not stay up; holds the end of its log."""

    def __init__(self, state: State, instance: str, problem: str) -> None:
        log = state.log_of(instance)
        super().__init__(problem, f"The whole log: {log}")
        self.tail = tail(log, TAIL_LINES)


class Launcher:
    """One system on this host; its services are in the order of their start."""

    def __init__(
        self, state: State, services: Sequence[Service], heartbeats: Heartbeats, progress: Progress
    ) -> None:
        self.state = state
        self.services = {service.name: service for service in services}
        self.heartbeats = heartbeats
        self.supervisor = Supervisor(state)
        self._progress = progress
        self._reasons = Reasons(progress)
        self._never_again = {
            name for service in services if service.restart == "no" for name in service.instances
        }
        self._started_s: dict[str, float] = {}
        self._reached: dict[str, str] = {}
        self._pids: dict[str, int] = {}
        self._restarted: set[str] = set()
        self._finished: set[str] = set()

    def start(self, robot: str, connect: str, timeout_s: float) -> None:
        """Start every service once its dependencies are healthy.

        Each service has to be healthy within `timeout_s` from its start; `connect`, the endpoint of
        the router, is written to the state. LaunchError if a service fails or is not healthy in
        time; everything is stopped again; People4dError if the system runs already.
        """
        self.state.prepare()
        with self.state.locked(0.0) as own:
            if not own:
                raise People4dError(
                    f"people4d is just being started or stopped for {robot}",
                    "Wait until that ends: people4d ps.",
                )
            self._spawn(robot, connect)
        try:
            self._start_services(timeout_s)
        except SupervisorGoneError as error:
            if self.state.was_stopped(STOP_S):
                raise People4dError("people4d down stopped it before it was ready") from error
            stop(self.state)
            raise
        except BaseException:
            stop(self.state)
            raise

    def _spawn(self, robot: str, connect: str) -> None:
        check_stopped(self.state, robot)
        swept = self.state.sweep()
        self.state.tidy()
        if swept:
            self._progress("left over", f"{swept} processes of a killed run ended")
        services = tuple(self.services.values())
        self.state.write(self.state.plan_file, msgspec.json.encode(services))
        try:
            pid = self.supervisor.spawn(services)
            self.state.write(
                self.state.run_file, msgspec.json.encode(Run(connect=connect, pid=pid))
            )
        except BaseException:
            self.state.sweep()
            raise

    def _start_services(self, timeout_s: float) -> None:
        while len(self._reached) < len(self.services):
            for name, service in self.services.items():
                if name not in self._started_s and all(map(self._met, service.depends_on)):
                    self._started_s[name] = time.monotonic()
                    for instance in service.instances:
                        self.supervisor.start(instance)
            processes = self.processes()
            for name in self._started_s:
                if self._reached.get(name) != "finished":
                    service = self.services[name]
                    self._follow(service, [processes[n] for n in service.instances], timeout_s)
            time.sleep(POLL_S)

    def _met(self, dependency: Dependency) -> bool:
        reached = self._reached.get(dependency.service)
        if dependency.condition == "service_started":
            return dependency.service in self._started_s
        if dependency.condition == "service_completed_successfully":
            return reached == "finished"
        return reached is not None

    def _follow(self, service: Service, processes: list[Process], timeout_s: float) -> None:
        """Follow a service from its start until it is healthy or finished."""
        starting = service.name not in self._reached
        for process in processes if starting else ():
            # A process that ends before it is ready is misconfigured: no retry.
            if process.state == "BACKOFF" or process.name in self._restarted:
                raise self._failure(process.name, "ended before it was ready")
        elapsed_s = time.monotonic() - self._started_s[service.name]
        if all(process.finished for process in processes):
            self._reached[service.name] = "finished"
        elif starting and self.heartbeats.healthy(service, processes):
            self._reached[service.name] = "healthy"
            self._progress(service.name, f"ready after {elapsed_s:.1f} s")
        elif starting and elapsed_s > timeout_s:
            raise self._late(processes, timeout_s)

    def _late(self, processes: list[Process], timeout_s: float) -> LaunchError:
        late = processes[0]
        reason = "it runs, but sends no heartbeat" if late.pid else f"it is {late.state}"
        for process in processes:
            health = of_instance(self.heartbeats.all(), process.name, process.pid)
            if health and not works(health):
                late, reason = process, f"it is {health.state}"
                reason += f": {health.reason}" if health.reason else ""
        return self._failure(late.name, f"is not ready after {timeout_s:.0f} s; {reason}")

    def _failure(self, instance: str, problem: str) -> LaunchError:
        error = LaunchError(self.state, instance, f"{instance} {problem}")
        with contextlib.suppress(OSError):
            (self.state.folder / FAILURE).write_text(str(error), encoding="utf-8")
        return error

    def processes(self) -> dict[str, Process]:
        """Return all processes by name, and report restarts; LaunchError if one failed for good."""
        processes = self.supervisor.processes()
        self._reasons.add_heartbeats(self.heartbeats.all())
        for name, process in processes.items():
            if process.gave_up or (process.ended_badly and name in self._never_again):
                problem = process.problem or f"exit status {process.exit_status}"
                raise self._failure(name, f"failed: {problem}")
            if process.finished and name not in self._finished:
                self._finished.add(name)
                reason = self._reason(name)
                self._progress(name, f"finished: {reason}" if reason else "finished")
            before = self._pids.get(name, 0)
            if process.pid and before and process.pid != before:
                self._restarted.add(name)
                hung = re.search(
                    rf"\b{re.escape(name)} (hung \([^)]*\))", self._reason(f"{WATCHDOG}-1")
                )
                self._progress(name, f"{hung[1] if hung else 'ended'} and was started again")
            self._pids[name] = process.pid or before
        return processes

    def _reason(self, instance: str) -> str:
        health = of_instance(self.heartbeats.all(), instance)
        return health.reason if health else ""

    def summary(self) -> str:
        """Return what is up after the start; a source without a frame, for example, is not."""
        ended = listed(sorted(self._finished))
        return f"Everything but {ended} is up" if ended else "Everything is up"

    def wait_finished(self, service: str) -> None:
        """Wait until every process of a service has finished; LaunchError if one failed."""
        while True:
            processes = self.processes()
            if all(processes[name].finished for name in self.services[service].instances):
                return
            time.sleep(POLL_S)

    def drain(self, timeout_s: float) -> None:
        """Wait until all frames are processed, and no service receives messages from them."""
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


def check_stopped(state: State, robot: str) -> None:
    """Check that no system of a robot runs here; People4dError if a system runs."""
    running = state.read()
    if running:
        raise People4dError(
            f"people4d runs already for {robot} (supervisord has process number {running.pid})",
            "Stop it with people4d down, or name another robot with --robot and --port.",
        )


def read_plan(state: State) -> tuple[Service, ...]:
    """Return the services of a running system; People4dError if its plan is missing or damaged."""
    try:
        return msgspec.json.decode(state.plan_file.read_bytes(), type=tuple[Service, ...])
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        raise People4dError(
            f"{state.plan_file} cannot be read ({error})", "Run people4d down, then people4d up."
        ) from error


def stop(state: State) -> bool:
    """Stop a system, the last started service first; return False if nothing ran.

    Supervisord waits for processes in turn; processes that do not end are killed together after
    STOP_S. A process that writes files has the stop grace period of its service.
    """
    with state.locked(STOP_TIMEOUT_S):
        running = state.read()
        if running:
            writing = _writing(state)
            spared = {running.pid, *writing}
            timeout_s = max([STOP_TIMEOUT_S, *writing.values()])
            with contextlib.suppress(SupervisorGoneError):  # supervisord is already stopping
                Supervisor(state).shutdown()
            start_s = time.monotonic()
            while state.read() and (elapsed_s := time.monotonic() - start_s) < timeout_s:
                if elapsed_s > STOP_S:
                    state.kill_processes(exclude=spared)
                time.sleep(POLL_S)
        swept = state.sweep()
        state.clear()
    return running is not None or swept > 0


def _writing(state: State) -> dict[int, float]:
    """Return the stop grace periods longer than STOP_S [s], by process."""
    with contextlib.suppress(People4dError):
        slow = [s for s in read_plan(state) if s.stop_grace_s > LONGEST_GRACE_S]
        processes = Supervisor(state).processes()
        return {
            processes[name].pid: s.stop_grace_s
            for s in slow
            for name in s.instances
            if name in processes
        }
    return {}


def tail(file: Path, lines: int) -> str:
    """Return the last lines of a log, empty if there is none."""
    try:
        with file.open(encoding="utf-8", errors="replace") as log:
            return "".join(deque(log, maxlen=lines)).rstrip("\n")
    except OSError:
        return ""
