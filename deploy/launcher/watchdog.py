"""Finds processes that hang, and has them started again: `python -m deploy.launcher.watchdog`.

supervisord starts again what dies; whether a process that lives still does anything, only its
heartbeat shows.
"""

import os
import socket
import sys
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.config import Config
from common.runtime import process
from common.runtime.node import Node, Status
from deploy.launcher.starvation import Starvation
from deploy.launcher.state import MARK, State
from deploy.launcher.supervisor import Process, Supervisor, SupervisorGoneError
from people4d.errors import ConfigError
from people4d.messages import Health, Message
from people4d.messages.base import Positive, PositiveInt

SERVICE = "watchdog"
ROUTER = "router"
PERIOD_NS = 250_000_000  # supervisord, too, sees what ended when it is asked
REPORT_S = 60.0
DEAD_S = 10.0
HEARD_MAX = 1024  # processes, a bound against invented ones
FORGET_S = 2.0  # after which heartbeats of another process number are forgotten
# After a restart; where several hang, or one that lacks a processor, each doubles it, up to ...
PAUSE_S = 2.0
PAUSE_MAX_S = 60.0
CALM_S = 3.0  # ... until for so long no process hung and none lacked a processor
STRAINED = (
    2.0  # times longer that a process takes for want of a processor, above which it lacks one
)


class WatchdogConfig(Config, frozen=True, kw_only=True):
    """Limits above which a process hangs. All values are this project's."""

    silent_s: Positive = 2.25  # [s] without a heartbeat, of which two come in a second
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

    last_s: float  # monotonic, of the last one
    state: str
    stalled_s: float | None = None  # monotonic, of the first one of this stall


class HangDetector:
    """Processes that hang, found by their heartbeats; without a clock or side effects.

    A process that gets too little of the processor has so many times longer. Heartbeats in the name
    of a process, but of another process number, say nothing about it.

    Args:
        config: Limits.
        slowdown: Returns how many times longer a process takes for want of a processor.
    """

    def __init__(
        self, config: WatchdogConfig, slowdown: Callable[[int], float] = lambda _: 1.0
    ) -> None:
        self._config, self._slowdown = config, slowdown
        self._heard: dict[tuple[str, int], _Heard] = {}  # by name and process number
        self.names: set[str] = set()  # processes heard of since this one runs
        self.unannounced = 0  # heartbeats in the name of processes that are not supervised here
        self._checked_s: float | None = None

    def hear(self, health: Health, now_s: float) -> None:
        """Note a heartbeat."""
        key = health.instance, health.pid
        if key not in self._heard and len(self._heard) >= HEARD_MAX:
            return
        before = self._heard.get(key)
        stalled_s = None
        if health.state == "stalled":
            stalled_s = before.stalled_s if before else None
            stalled_s = now_s if stalled_s is None else stalled_s
        self._heard[key] = _Heard(now_s, health.state, stalled_s)

    def hung(self, processes: Mapping[str, Process], now_s: float) -> dict[str, str]:
        """Return the processes of those that run which hang, by name, each with the reason."""
        self._excuse(now_s)
        self._forget(processes, now_s)
        running = [p for p in processes.values() if p.state == "RUNNING"]
        watched = [p for p in running if p.name in self.names]
        found = {p.name: why for p in watched if (why := self._why(p, now_s))}
        silent = [p.name for p in watched if p.name in found and self._is_silent(p, now_s)]
        # A watchdog that hears no process at all may itself be cut off.
        if len(silent) == len(watched) > 1:
            return {name: why for name, why in found.items() if name.startswith(f"{ROUTER}-")}
        return found

    def _forget(self, processes: Mapping[str, Process], now_s: float) -> None:
        """Forget heartbeats of process numbers that are not, or no longer, of our processes."""
        pids = {p.name: p.pid for p in processes.values()}
        self.names |= {name for name, pid in self._heard if pids.get(name) == pid}
        self.unannounced += len({name for name, _ in self._heard} - pids.keys())
        # The list of processes may be older than the heartbeat of a new one.
        self._heard = {
            (name, pid): heard
            for (name, pid), heard in self._heard.items()
            if pids.get(name) == pid or (name in pids and now_s - heard.last_s < FORGET_S)
        }

    def _excuse(self, now_s: float) -> None:
        """Excuse processes for a time in which this process itself did not run."""
        asleep_s = 0.0 if self._checked_s is None else now_s - self._checked_s - 4 * PERIOD_NS / 1e9
        self._checked_s = now_s
        if asleep_s > 0:
            for heard in self._heard.values():
                heard.last_s = min(now_s, heard.last_s + asleep_s)

    def _why(self, process: Process, now_s: float) -> str:
        heard, config = self._heard.get((process.name, process.pid)), self._config
        if heard is None:  # started anew, and not heard of since
            late = process.uptime_s > config.start_s * self._slowdown(process.pid)
            return f"no heartbeat within {config.start_s:.0f} s of its start" if late else ""
        if self._is_silent(process, now_s):
            return f"no heartbeat for {now_s - heard.last_s:.0f} s"
        stalled_s = config.stalled_s * self._slowdown(process.pid)
        if heard.stalled_s is not None and now_s - heard.stalled_s > stalled_s:
            return f"stalled for {now_s - heard.stalled_s:.0f} s"
        return ""

    def was_heard(self, process: Process) -> bool:
        """Check that this very process, not one before it of its name, sent a heartbeat."""
        return (process.name, process.pid) in self._heard

    def _is_silent(self, process: Process, now_s: float) -> bool:
        heard = self._heard.get((process.name, process.pid))
        if heard is None:
            return False
        # Who stops may close files for a while.
        limit_s = self._config.start_s if heard.state == "stopping" else self._config.silent_s
        return now_s - heard.last_s > limit_s * self._slowdown(process.pid)


class WatchdogNode(Node):
    """Ends processes of this host that hang, so that supervisord starts them again."""

    inputs: tuple[type[Message], ...] = (Health,)

    def __init__(self, config: WatchdogConfig, supervisor: Supervisor, host: str) -> None:
        self._config = config
        self._host = host
        self._supervisor = supervisor
        self._starvation = Starvation()
        self._watch = HangDetector(config, self._starvation.slowdown)
        self._due_ns = 0
        self._next_s = 0.0  # monotonic, before which nothing is started again
        self._streak = 0  # restarts since the last calm
        self._strained = False  # several hang, or one that lacks a processor
        self._calm_since_s: float | None = None  # monotonic
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
        """Check four times a second whether a process hangs."""
        self._now_s = now_ns / 1e9
        if now_ns >= self._due_ns:
            # When this process itself is late, heartbeats wait that it has not read yet.
            late = 0 < self._due_ns < now_ns - PERIOD_NS
            self._due_ns = now_ns + PERIOD_NS
            if not late:
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
            counters={**self._counters, "unannounced": self._watch.unannounced},
        )

    def _check(self, now_s: float) -> None:
        try:
            processes = self._supervisor.processes()
            self._starvation.update([p.pid for p in processes.values() if p.pid], now_s)
            hung = self._watch.hung(processes, now_s)
            self._note_calm(processes, now_s, hung)
            # The router first: others may be silent for want of it.
            for name in sorted(hung, key=lambda name: not name.startswith(f"{ROUTER}-")):
                # supervisord notices within a second that a process is gone.
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
        """Begin the pauses between restarts anew once all processes have been well for a while."""
        watched = [p for p in processes.values() if p.name in self._watch.names]
        lacking = {p.name for p in watched if self._starvation.slowdown(p.pid) >= STRAINED}
        # One that hangs for itself is started again soon, however slow the others are.
        self._strained = len(hung) > 1 or not lacking.isdisjoint(hung)
        lack = bool(lacking - hung.keys())
        well = not hung and not lack and all(map(self._watch.was_heard, watched))
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
        # Before its first heartbeat a process may not have the handler that writes a trace.
        self._supervisor.kill(name, trace=self._watch.was_heard(ended))
        # Each restart adds load, which makes others slow where the machine is.
        self._streak = self._streak if self._strained else 0
        self._next_s = now_s + min(PAUSE_S * 2**self._streak, PAUSE_MAX_S)
        self._streak += self._strained
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
