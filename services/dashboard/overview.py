"""Packets of health, latency by stage and diagnostics for the page."""

import time
from collections.abc import Iterator
from typing import Any

from common.diagnosis.checks import examine
from common.diagnosis.evidence import HEARD, Evidence
from common.runtime.monitor import Monitor, SystemSnapshot
from common.transport.trace import ProcessId
from people4d.messages import Health, Message, Tracks
from people4d.queue import Arrival
from services.dashboard.selection import FrameSelection

PERIOD_NS = 1_000_000_000
LISTEN_S = 4.0  # duration of the evidence of a diagnosis [s]
WINDOW_S = 3.0  # window of latencies [s]
NAME = "dashboard"


class Overview:
    """Collects health and evidence while a page is open."""

    def __init__(self) -> None:
        self._monitor = Monitor(ProcessId(NAME, NAME, ""), WINDOW_S)
        self._evidence = Evidence(robot="")
        self._since_s = time.monotonic()
        self.due_ns = 0

    def restart(self) -> None:
        """Restart the evidence."""
        transforms, infos = self._evidence.transforms, self._evidence.infos
        self._evidence = Evidence(robot="", transforms=transforms, infos=infos)
        self._since_s = time.monotonic()

    def add_message(self, message: Message, selection: FrameSelection) -> None:
        """Add a message; a Tracks message also counts the skipped ones before it."""
        now_ns = time.time_ns()
        if isinstance(message, HEARD):
            self._evidence.add_message(message, now_ns)
            self._monitor.add_arrival(Arrival(message, now_ns, now_ns), now_ns, time.monotonic())
        if isinstance(message, Tracks):
            self._evidence.tracks += [message] * (selection.count_tracks() - 1)

    def due(self, now_ns: int) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield the names and packets that are due at a monotonic time."""
        if now_ns < self.due_ns:
            return
        self.due_ns = now_ns + PERIOD_NS
        now_s = time.monotonic()
        yield "health", _health(self._monitor.snapshot(now_s), self._monitor.healths(now_s))
        elapsed_s = now_s - self._since_s
        if elapsed_s >= LISTEN_S:
            self._evidence.elapsed_s = elapsed_s
            diagnostics = examine(self._evidence) if self._evidence.vitals else []
            yield "diagnosis", {"type": "diagnosis", "diagnostics": diagnostics}
            self.restart()


def _health(system: SystemSnapshot, healths: list[Health]) -> dict[str, Any]:
    drops = {
        health.instance: {n: c for n, c in health.counters.items() if n.startswith("dropped_")}
        for health in healths
    }
    return {
        "type": "health",
        "end_to_end": system.end_to_end,
        "clocks": system.clocks,
        "processes": [one for one in system.processes if one.service != NAME or one.state],
        "drops": drops,
    }
