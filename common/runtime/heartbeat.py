"""Heartbeat of a process: its Health, published twice a second from a thread of its own."""

import contextlib
import functools
import importlib.metadata
import logging
import os
import threading
import time
from collections import Counter
from collections.abc import Iterator
from typing import Literal

import psutil

from common.runtime.error_log import ErrorLog
from common.runtime.inbox import Inbox
from common.runtime.node import Node, Status
from common.runtime.throughput import Throughput
from common.transport.clock import ClockMonitor
from common.transport.trace import ProcessId
from common.transport.zenoh_bus import ZenohBus
from people4d.messages import Health
from people4d.messages.status import State
from people4d.topics import BY_MESSAGE

PERIOD_S = 0.5
STALLED_AFTER_S = 2.0
REASON_MAX = 1000  # maximum length of a reason [characters]

log = logging.getLogger("people4d")


@functools.cache
def release() -> str:
    """Return the version of the installed package, for example "0.1.0"."""
    return importlib.metadata.version("people4d")


class Activity:
    """Current work of the threads of a loop, and counters of their past work."""

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self.problem = ""  # problem of the process outside its node, one sentence
        self.errors = ErrorLog()
        self._since: dict[int, float] = {}
        self._lock = threading.Lock()
        self._received_ns: dict[str, int] = {}

    def note_taken(self, topic: str, received_ns: int) -> None:
        """Record that work on a message begins."""
        self._received_ns[topic] = received_ns

    def ages(self) -> dict[str, float]:
        """Return the age of the newest handled message of each topic [ms], by gauge."""
        now_ns, received_ns = time.time_ns(), list(self._received_ns.items())
        return {f"age_{topic}_ms": (now_ns - ns) / 1e6 for topic, ns in received_ns}

    def count(self, name: str) -> None:
        """Count an event."""
        with self._lock:
            self.counters[name] += 1

    def note_error(self, error: Exception, what: str) -> None:
        """Count an exception, which becomes the reason; see `ErrorLog.add_error`."""
        self.count("errors")
        self.errors.add_error(error, what)

    @contextlib.contextmanager
    def busy(self) -> Iterator[None]:
        """Mark this thread as busy inside the block."""
        own_id, start = threading.get_ident(), time.monotonic()
        self._since[own_id] = start
        try:
            yield
        finally:
            del self._since[own_id]

    def longest_busy_s(self) -> float:
        """Return the longest duration of the threads' current work [s]."""
        started = list(self._since.values())
        return time.monotonic() - min(started) if started else 0.0


class Heartbeat:
    """Publishes Health until closed.

    A process is `ready`; `degraded` if it works with limits or lacks inputs; `stalled` if its own
    work makes no progress. The reason is addressed to users.

    Args:
        node: Node of the process.
        bus: ZenohBus to publish on.
        process_id: Identity of the process.
        inbox: Source of counters.
        activity: Source of counters, and of the duration of the current work.
    """

    def __init__(
        self, node: Node, bus: ZenohBus, process_id: ProcessId, inbox: Inbox, activity: Activity
    ) -> None:
        self._node, self._bus, self._process_id = node, bus, process_id
        self._inbox, self._activity = inbox, activity
        self._process = psutil.Process()
        self._clock = ClockMonitor(bus)
        self._sequence = 0
        self._before: tuple[float, Counter[str]] = (time.monotonic(), Counter())
        inputs = [BY_MESSAGE[kind] for kind in node.required_inputs]
        outputs = [BY_MESSAGE[kind] for kind in node.periodic_outputs]
        self._throughput = Throughput(inputs, outputs, time.monotonic())
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Publish a last heartbeat and end."""
        self._closed.set()
        self._thread.join()
        self._publish("stopping")

    def _run(self) -> None:
        while not self._closed.is_set():
            self._clock.query()
            self._publish()
            self._closed.wait(PERIOD_S)

    def _publish(self, state: State | None = None) -> None:
        try:
            self._bus.publish(self._health(state))
        except Exception:  # the heartbeat must survive the faults that it reports
            log.exception("no heartbeat")

    def _health(self, state: State | None) -> Health:
        status = self._node.status()
        # Copies: other threads keep counting. Zeros are published too.
        counters = Counter(dict(status.counters))
        counters.update(dict(self._inbox.counters))
        counters.update(dict(self._activity.counters))
        counters.update(self._clock.counters())
        counters.update(dict(self._bus.counters))
        now, reason = (state, status.reason) if state else self._assess(status, counters)
        self._sequence += 1
        return Health(
            stamp_ns=time.time_ns(),
            sequence=self._sequence - 1,
            service=self._process_id.service,
            instance=self._process_id.instance,
            host=self._process_id.host,
            pid=os.getpid(),
            release=release(),
            state="stopping" if now == "finished" else now,
            # The reason may quote errors of other code, of many lines and any length.
            reason="".join(c if c.isprintable() else " " for c in reason[:REASON_MAX]),
            counters=dict(counters),
            gauges=self._gauges(counters) | status.gauges,
        )

    def _assess(
        self, status: Status, counters: Counter[str]
    ) -> tuple[State | Literal["finished"], str]:
        """Return state and reason: the node's own, and problems that only the process knows."""
        now_s, stuck_s = time.monotonic(), self._activity.longest_busy_s()
        # Called at each heartbeat: both methods compare with the counters of the previous one.
        missing = self._throughput.missing(counters, now_s)
        losing = self._throughput.losing(counters, now_s)
        if stuck_s > STALLED_AFTER_S:
            return "stalled", f"busy with one message for {stuck_s:.0f} s"
        if status.state not in ("ready", "degraded"):
            return status.state, status.reason
        if self._inbox.last_error_is_fresh():
            losing = self._inbox.last_error
        found = (self._activity.errors.reason(), self._activity.problem, missing, losing)
        problems = [problem for problem in found if problem]
        reasons = [status.reason, *problems] if status.reason else problems
        degraded = bool(problems) or status.state == "degraded"
        return ("degraded" if degraded else "ready"), "; ".join(reasons)

    def _gauges(self, counters: Counter[str]) -> dict[str, float]:
        """Return message rates, processor share, memory, ages of inputs, and clock offsets."""
        now = time.monotonic()
        then, before = self._before
        self._before = (now, counters)
        elapsed = max(now - then, 1e-3)
        rates = {
            f"{name}_hz": (count - before[name]) / elapsed
            for name, count in counters.items()
            if name.startswith(("received_", "sent_"))
        }
        memory_mb = self._process.memory_info().rss / 2**20
        own = {"cpu_percent": self._process.cpu_percent(), "memory_mb": memory_mb}
        return rates | own | self._activity.ages() | self._clock.gauges()
