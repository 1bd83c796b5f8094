"""Reasons of processes that are starting or degraded, each reported once."""

import re
import time
from collections.abc import Callable, Sequence

from people4d.messages import Health

DELAY_S = 4.0  # minimum duration of a reported reason, since many are short at the start [s]
LIMIT_PERCENT = 90.0  # minimum share of a core of a process at its limit [%]
NUMBER = re.compile(r"[\d.]+")
WAITS = re.compile(r"no [\w ,]+ for \d+ s")  # reason of a process that waits for another process


class Reasons:
    """Reports lasting reasons; a change of numbers alone is not reported."""

    def __init__(self, progress: Callable[[str, str], None]) -> None:
        self._progress = progress
        self._since_s: dict[tuple[str, str], float] = {}
        self._reported: set[tuple[str, str]] = set()

    def add_heartbeats(self, healths: Sequence[Health]) -> None:
        """Add the last heartbeats of all processes."""
        now_s = time.monotonic()
        present = {
            (health.instance, NUMBER.sub("", health.reason)): health.reason
            for health in healths
            if health.reason
            and health.state in ("starting", "degraded")
            and not WAITS.fullmatch(health.reason)
        }
        self._since_s = {key: self._since_s.get(key, now_s) for key in present}
        for key, reason in present.items():
            if now_s - self._since_s[key] >= DELAY_S and key not in self._reported:
                self._reported.add(key)
                self._progress(key[0], reason + _busy(healths))


def _busy(healths: Sequence[Health]) -> str:
    """List the processes that use a whole core; empty if there are none."""
    loads = {h.instance: h.gauges.get("cpu_percent", 0.0) for h in healths}
    names = [f"{name} {load:.0f} %" for name, load in loads.items() if load >= LIMIT_PERCENT]
    return f" (at its limit: {', '.join(names)} of a core)" if names else ""
