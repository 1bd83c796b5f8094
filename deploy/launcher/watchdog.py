"""Watchdog that restarts hanging processes: `python -m deploy.launcher.watchdog`.

supervisord restarts processes that end; only heartbeats show that a process hangs.
"""

import math
import os
import shutil
import socket
import sys
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from common.runtime import process
from common.runtime.node import Node, Status
from deploy.launcher.hangs import PERIOD_NS, ROUTER, HangDetector, WatchdogConfig
from deploy.launcher.state import MARK, State
from deploy.launcher.supervisor import Process, Supervisor, SupervisorGoneError
from people4d.errors import ConfigError
from people4d.messages import Health, Message

SERVICE = "watchdog"
REPORT_S = 60.0
DEAD_S = 10.0
ROOM_BYTES = 2**20  # minimum free space on the disk of the state folder
FULL = "the disk of the state folder is full: logs, events and states of services may be lost"
PAUSE_S = 2.0  # pause after a restart, doubled by each restart while several processes hang [s]
PAUSE_MAX_S = 60.0  # maximum pause [s]
CALM_S = 3.0  # time without a hung process that resets the pause [s]


class WatchdogNode(Node):
    """Restarts hanging processes of this host, and reports a full disk.

    Args:
        config: Limits.
        supervisor: Supervisord, which restarts a killed process.
        host: Name of this host.
        free_bytes: Returns the free space on the disk of the state folder.
    """

    inputs: tuple[type[Message], ...] = (Health,)

    def __init__(
        self,
        config: WatchdogConfig,
        supervisor: Supervisor,
        host: str,
        free_bytes: Callable[[], float] = lambda: math.inf,
    ) -> None:
        self._free_bytes = free_bytes
        self._config = config
        self._host = host
        self._supervisor = supervisor
        self._watch = HangDetector(config)
        self._due_ns = 0
        self._next_s = 0.0  # [s] monotonic time of the next allowed restart
        self._streak = 0  # number of restarts since the last calm time
        self._strained = False  # True if several processes hang
        self._calm_since_s: float | None = None  # monotonic
        self._ended_s: dict[str, deque[float]] = {}  # [s] monotonic times of restarts by process
        # Process number and monotonic time of the last kill, by process
        self._killed: dict[str, tuple[int, float]] = {}
        self._counters: Counter[str] = Counter(restarts=0)
        self._now_s = 0.0
        self._last: tuple[float, str] = (-REPORT_S, "")
        self._left_alone: dict[str, str] = {}
        self._gone = ""

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Add a heartbeat of this host."""
        if isinstance(message, Health) and message.host == self._host:
            self._watch.add_heartbeat(message, now_ns / 1e9)
        return ()

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Check for hanging processes four times a second."""
        self._now_s = now_ns / 1e9
        if now_ns >= self._due_ns:
            # A late watchdog has unread heartbeats.
            late = 0 < self._due_ns < now_ns - PERIOD_NS
            self._due_ns = now_ns + PERIOD_NS
            if not late:
                self._check(self._now_s)
        return ()

    def wake_ns(self) -> int | None:
        """Return the time of the next check."""
        return self._due_ns

    def status(self) -> Status:
        """Return recent restarts, and the processes without further restarts."""
        full = FULL if self._free_bytes() < ROOM_BYTES else ""
        problems = [*self._left_alone.values(), *filter(None, [self._gone, full])]
        when_s, what = self._last
        lately = [what] if self._now_s - when_s < REPORT_S else []
        return Status(
            state="degraded" if problems else "ready",
            reason="; ".join(problems or lately),
            counters={**self._counters, "unannounced": self._watch.unannounced},
        )

    def _check(self, now_s: float) -> None:
        try:
            processes = self._supervisor.processes()
            hung = self._watch.hung(processes, now_s)
            self._note_calm(processes, now_s, hung)
            # The router comes first, since all processes are silent without it.
            for name in sorted(hung, key=lambda name: not name.startswith(f"{ROUTER}-")):
                # supervisord detects the end of a process within a second.
                pid, when_s = self._killed.get(name, (0, 0.0))
                gone = processes[name].pid == pid and now_s - when_s <= DEAD_S
                if not gone and now_s >= self._next_s:
                    self._killed[name] = (processes[name].pid, now_s)
                    self._end(processes[name], hung[name], now_s)
            self._left_alone = {n: why for n, why in self._left_alone.items() if n in hung}
            self._gone = ""
        except SupervisorGoneError as error:
            self._gone = str(error)

    def _note_calm(
        self, processes: Mapping[str, Process], now_s: float, hung: Mapping[str, str]
    ) -> None:
        """Reset the pause between restarts once all processes have worked for a while."""
        watched = [p for p in processes.values() if p.name in self._watch.names]
        self._strained = len(hung) > 1
        well = not hung and all(map(self._watch.was_heard, watched))
        if not well:
            self._calm_since_s = None
        elif self._calm_since_s is None:
            self._calm_since_s = now_s
        elif now_s - self._calm_since_s >= CALM_S:
            self._streak = 0

    def _end(self, ended: Process, why: str, now_s: float) -> None:
        name = ended.name
        config, ended_s = self._config, self._ended_s.setdefault(name, deque())
        while ended_s and now_s - ended_s[0] > config.restarts_window_s:
            ended_s.popleft()
        if len(ended_s) >= config.restarts_max:
            often = f"{len(ended_s)} times in {config.restarts_window_s:.0f} s"
            self._left_alone[name] = f"{name} hung {often} and is left alone now ({why})"
            return
        process.log.warning("%s hangs (%s) and is started again", name, why)
        # Before its first heartbeat a process may have no handler that writes a trace.
        self._supervisor.kill(name, trace=self._watch.was_heard(ended))
        # Each restart adds load, which slows other processes of an overloaded machine.
        self._streak = self._streak if self._strained else 0
        self._next_s = now_s + min(PAUSE_S * 2**self._streak, PAUSE_MAX_S)
        self._streak += self._strained
        ended_s.append(now_s)
        self._last = (now_s, f"{name} hung ({why}) and was started again")
        self._counters["restarts"] += 1
        self._counters[f"restarts_{name}"] += 1


def build(config: WatchdogConfig) -> WatchdogNode:
    """Build the node for the system of this process."""
    folder = os.environ.get(MARK)
    if not folder:
        raise ConfigError("the watchdog is part of a system", "people4d up starts it.")
    return WatchdogNode(
        config, Supervisor(State(Path(folder))), socket.gethostname(), lambda: _free_bytes(folder)
    )


def _free_bytes(folder: str) -> float:
    """Return the free space on the disk of a folder; infinite if unknown."""
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return math.inf


def main() -> int:
    """Run the watchdog and return its exit code."""
    return process.main(SERVICE, WatchdogConfig, build)


if __name__ == "__main__":
    sys.exit(main())
