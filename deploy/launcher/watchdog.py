"""Finds processes that hang, and has them started again: `python -m deploy.launcher.watchdog`.

supervisord starts again what dies; whether a process that lives still does anything, only its
heartbeat shows.
"""

import os
import socket
import sys
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from common.config import Config
from common.runtime import process
from common.runtime.node import Node, Status
from deploy.launcher.state import MARK, State
from deploy.launcher.supervisor import Process, Supervisor, SupervisorGoneError
from people4d.errors import ConfigError
from people4d.messages import Health, Message
from people4d.messages.base import Positive, PositiveInt

SERVICE = "watchdog"
ROUTER = "router"
PERIOD_NS = 500_000_000
REPORT_S = 60.0
DEAD_S = 10.0


class WatchdogConfig(Config, frozen=True, kw_only=True):
    """Limits above which a process hangs. All values are this project's."""

    silent_s: Positive = 4.0  # [s] without a heartbeat, of which two come in a second
    # [s] in which a process says that it is stalled, which it does 2 s after it took a message that
    # it is still busy with
    stalled_s: Positive = 8.0
    # [s] from its start to the first heartbeat of a process that is to come back: it may load a
    # model. Before it was ever heard of, `people4d up --timeout` counts.
    start_s: Positive = 120.0
    restarts_max: PositiveInt = 5  # of one process within restarts_window_s; then it is left alone
    restarts_window_s: Positive = 300.0  # [s]


@dataclass(slots=True)
class _Heard:
    """Last heartbeat of one process."""

    pid: int
    last_s: float  # monotonic, of the last one
    state: str
    stalled_s: float | None = None  # monotonic, of the first one of this stall


class HangDetector:
    """Processes that hang, found by their heartbeats; without a clock or side effects."""

    def __init__(self, config: WatchdogConfig) -> None:
        self._config = config
        self._heard: dict[str, _Heard] = {}
        self._checked_s: float | None = None

    def hear(self, health: Health, now_s: float) -> None:
        """Note a heartbeat."""
        before = self._heard.get(health.instance)
        stalled_s = None
        if health.state == "stalled":
            same = before is not None and before.pid == health.pid
            since_s = before.stalled_s if before and same else None
            stalled_s = now_s if since_s is None else since_s
        self._heard[health.instance] = _Heard(health.pid, now_s, health.state, stalled_s)

    def hung(self, processes: Mapping[str, Process], now_s: float) -> dict[str, str]:
        """Return the processes of those that run which hang, by name, each with the reason."""
        self._excuse(now_s)
        running = [p for p in processes.values() if p.state == "RUNNING"]
        watched = [p for p in running if p.name in self._heard]
        found = {p.name: why for p in watched if (why := self._why(p, now_s))}
        silent = [name for name in found if self._is_silent(name, now_s)]
        # A watchdog that hears no process at all may itself be cut off.
        if len(silent) == len(watched) > 1:
            return {name: why for name, why in found.items() if name.startswith(f"{ROUTER}-")}
        return found

    def _excuse(self, now_s: float) -> None:
        """Excuse processes for a time in which this process itself did not run."""
        asleep_s = 0.0 if self._checked_s is None else now_s - self._checked_s - 3 * PERIOD_NS / 1e9
        self._checked_s = now_s
        if asleep_s > 0:
            for heard in self._heard.values():
                heard.last_s = min(now_s, heard.last_s + asleep_s)

    def _why(self, process: Process, now_s: float) -> str:
        heard, config = self._heard[process.name], self._config
        if heard.pid != process.pid:  # started anew, and not heard of since
            late = process.uptime_s > config.start_s
            return f"no heartbeat within {config.start_s:.0f} s of its start" if late else ""
        if self._is_silent(process.name, now_s):
            return f"no heartbeat for {now_s - heard.last_s:.0f} s"
        if heard.stalled_s is not None and now_s - heard.stalled_s > config.stalled_s:
            return f"stalled for {now_s - heard.stalled_s:.0f} s"
        return ""

    def _is_silent(self, name: str, now_s: float) -> bool:
        heard = self._heard[name]
        # Who stops may close files for a while.
        limit_s = self._config.start_s if heard.state == "stopping" else self._config.silent_s
        return now_s - heard.last_s > limit_s


class WatchdogNode(Node):
    """Ends processes of this host that hang, so that supervisord starts them again."""

    inputs: ClassVar[tuple[type[Message], ...]] = (Health,)

    def __init__(self, config: WatchdogConfig, supervisor: Supervisor, host: str) -> None:
        self._config = config
        self._host = host
        self._supervisor = supervisor
        self._watch = HangDetector(config)
        self._due_ns = 0
        self._ended_s: dict[str, deque[float]] = {}  # monotonic, by process
        self._killed: dict[str, tuple[int, float]] = {}  # process number and monotonic time
        self._counters: Counter[str] = Counter(restarts=0)
        self._now_s = 0.0
        self._last: tuple[float, str] = (-REPORT_S, "")
        self._left_alone: dict[str, str] = {}
        self._gone = ""

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Take a heartbeat."""
        if isinstance(message, Health) and message.host == self._host:
            self._watch.hear(message, now_ns / 1e9)
        return ()

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Look twice a second whether anyone hangs."""
        self._now_s = now_ns / 1e9
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + PERIOD_NS
            self._check(self._now_s)
        return ()

    def wake_ns(self) -> int | None:
        """Return when to look again."""
        return self._due_ns

    def status(self) -> Status:
        """Return the processes that were ended lately, and those left alone."""
        problems = [*self._left_alone.values(), *filter(None, [self._gone])]
        when_s, what = self._last
        lately = [what] if self._now_s - when_s < REPORT_S else []
        return Status(
            state="degraded" if problems else "ready",
            reason="; ".join(problems or lately),
            counters=dict(self._counters),
        )

    def _check(self, now_s: float) -> None:
        try:
            processes = self._supervisor.processes()
            hung = self._watch.hung(processes, now_s)
            for name, why in hung.items():
                # supervisord notices within a second that a process is gone.
                pid, when_s = self._killed.get(name, (0, 0.0))
                if processes[name].pid != pid or now_s - when_s > DEAD_S:
                    self._killed[name] = (processes[name].pid, now_s)
                    self._end(name, why, now_s)
            self._left_alone = {n: why for n, why in self._left_alone.items() if n in hung}
            self._gone = ""
        except SupervisorGoneError as error:
            self._gone = str(error)

    def _end(self, name: str, why: str, now_s: float) -> None:
        config, ended_s = self._config, self._ended_s.setdefault(name, deque())
        while ended_s and now_s - ended_s[0] > config.restarts_window_s:
            ended_s.popleft()
        if len(ended_s) >= config.restarts_max:
            often = f"{len(ended_s)} times in {config.restarts_window_s:.0f} s"
            self._left_alone[name] = f"{name} hung {often} and is left alone now ({why})"
            return
        process.log.warning("%s hangs (%s) and is started again", name, why)
        self._supervisor.kill(name)
        ended_s.append(now_s)
        self._last = (now_s, f"{name} hung ({why}) and was started again")
        self._counters["restarts"] += 1
        self._counters[f"restarts_{name}"] += 1


def build(config: WatchdogConfig) -> WatchdogNode:
    """Build the node for the system that this process is part of."""
    folder = os.environ.get(MARK)
    if not folder:
        raise ConfigError("the watchdog is part of a system", "people4d up starts it.")
    return WatchdogNode(config, Supervisor(State(Path(folder))), socket.gethostname())


def main() -> int:
    """Run the watchdog and return its exit code."""
    return process.main(SERVICE, WatchdogConfig, build)


if __name__ == "__main__":
    sys.exit(main())
