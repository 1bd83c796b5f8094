"""Detection of hanging processes by their heartbeats."""

from collections.abc import Mapping
from dataclasses import dataclass

from common.config import Config
from deploy.launcher.supervisor import Process
from people4d.messages import Health
from people4d.messages.base import Positive, PositiveInt

ROUTER = "router"
# Period of the checks [ns]; supervisord, too, detects ended processes on request
PERIOD_NS = 250_000_000
HEARD_MAX = 1024  # maximum number of processes, a bound against invented names
FORGET_S = 2.0  # maximum age of stored heartbeats of another process number [s]


class WatchdogConfig(Config, frozen=True, kw_only=True):
    """Limits above which a process hangs; values are set by this project."""

    silent_s: Positive = 2.25  # [s] maximum silence; heartbeats come twice a second
    # [s] maximum time in state stalled, which begins after 2 s with one message
    stalled_s: Positive = 8.0
    # [s] maximum time from a restart to the first heartbeat, with the loading of a model; the first
    # start has the limit of `people4d up --timeout`
    start_s: Positive = 120.0
    restarts_max: PositiveInt = 5  # maximum number of restarts of one process in restarts_window_s
    restarts_window_s: Positive = 300.0  # [s] period of restarts_max


@dataclass(slots=True)
class _Heard:
    """Last heartbeat of one process."""

    last_s: float  # [s] monotonic time of the last heartbeat
    state: str
    stalled_s: float | None = None  # [s] monotonic time of the first heartbeat in state stalled


class HangDetector:
    """Detects hanging processes by their heartbeats, without a clock or side effects.

    Heartbeats with the name of a process, but another process number, are ignored.
    """

    def __init__(self, config: WatchdogConfig) -> None:
        self._config = config
        self._heard: dict[tuple[str, int], _Heard] = {}  # last heartbeat by name and process number
        self.names: set[str] = set()  # names of processes with a heartbeat
        self.unannounced = 0  # number of heartbeats of unsupervised processes
        self._checked_s: float | None = None

    def add_heartbeat(self, health: Health, now_s: float) -> None:
        """Add a heartbeat."""
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
        """Return the reason of each hanging process by its name."""
        self._excuse(now_s)
        self._forget(processes, now_s)
        running = [p for p in processes.values() if p.state == "RUNNING"]
        watched = [p for p in running if p.name in self.names]
        found = {p.name: why for p in watched if (why := self._why(p, now_s))}
        silent = [p.name for p in watched if p.name in found and self._is_silent(p, now_s)]
        # A watchdog that receives no heartbeat may itself be disconnected.
        if len(silent) == len(watched) > 1:
            return {name: why for name, why in found.items() if name.startswith(f"{ROUTER}-")}
        return found

    def _forget(self, processes: Mapping[str, Process], now_s: float) -> None:
        """Delete heartbeats of processes not started by this system."""
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
        """Extend all limits by a suspension of this process."""
        asleep_s = 0.0 if self._checked_s is None else now_s - self._checked_s - 4 * PERIOD_NS / 1e9
        self._checked_s = now_s
        if asleep_s > 0:
            for heard in self._heard.values():
                heard.last_s = min(now_s, heard.last_s + asleep_s)

    def _why(self, process: Process, now_s: float) -> str:
        heard, config = self._heard.get((process.name, process.pid)), self._config
        if heard is None:  # no heartbeat since the restart
            late = process.uptime_s > config.start_s
            return f"no heartbeat within {config.start_s:.0f} s of its start" if late else ""
        if self._is_silent(process, now_s):
            return f"no heartbeat for {now_s - heard.last_s:.0f} s"
        if heard.stalled_s is not None and now_s - heard.stalled_s > config.stalled_s:
            return f"stalled for {now_s - heard.stalled_s:.0f} s"
        return ""

    def was_heard(self, process: Process) -> bool:
        """Check that a heartbeat is from the current process and not from an earlier one."""
        return (process.name, process.pid) in self._heard

    def _is_silent(self, process: Process, now_s: float) -> bool:
        heard = self._heard.get((process.name, process.pid))
        if heard is None:
            return False
        # A stopping process may take long to close files.
        limit_s = self._config.start_s if heard.state == "stopping" else self._config.silent_s
        return now_s - heard.last_s > limit_s
