"""Observation of an attacked system: people, identities, processes, memory and diagnostics."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import psutil

from common.diagnosis.checks import examine
from common.diagnosis.evidence import HEARD, Evidence
from people4d.client import Client
from people4d.messages import F64, Health, Message, Tracks
from tests.attacks.reports import Report
from tests.integration.system import ROBOT, System

ATTACKER = Path(__file__).with_name("attacker.py")
CAMERA = "front"
PEOPLE = 3
NEAR_M = 0.8  # maximum distance of a standing person from the known position [m]
# Number of messages with all people before an attack, which show the machine's own pauses
CALM = 6
WAIT_S = 40.0
ATTACK_S = 60.0
TOKENS_S = 0.5  # between two looks for tokens of processes


@dataclass(frozen=True)
class Snapshot:
    """State of a system at one time."""

    pids: dict[str, int]  # process number by instance
    memory_mb: dict[str, float]  # resident, by instance
    positions_m: dict[int, F64]  # positions by identity, in the last frame with all people matched
    errors: int  # exceptions in all processes since their start


@dataclass
class Observer:
    """Receives people and heartbeats of a system in a thread of its own."""

    system: System
    # Arrivals of messages with matched people
    arrivals_s: list[float] = field(default_factory=list)
    healths: dict[str, Health] = field(default_factory=dict)  # last genuine heartbeat by instance
    evidence: Evidence = field(default_factory=lambda: Evidence(robot=ROBOT))
    # Positions in the last message with matched people
    positions_m: dict[int, F64] = field(default_factory=dict)
    identities: set[int] = field(default_factory=set)  # identities of all people since `begin`
    calm_s: float = 0.0  # longest pause of people before the attack, caused by the machine
    discontent_before: set[str] = field(default_factory=set)  # the same for checks of the doctor
    # Monotonic time at which each part of the expected report arrived
    reported_s: dict[str, float] = field(default_factory=dict)
    _expected: Report = field(default_factory=Report)
    _counted: int = 0  # value of the expected counter before the attack

    def __post_init__(self) -> None:
        self._client = Client(self.system.connect, ROBOT, WAIT_S)
        # Subscribed as a planner, so that a flood of other messages does not delay it
        self._planner = Client(self.system.connect, ROBOT, WAIT_S)
        self._arrived = threading.Condition(threading.RLock())
        self._started_s = time.monotonic()
        self._pids = self.system.pids()
        self._closed = threading.Event()
        self._threads = [
            threading.Thread(target=work, daemon=True)
            for work in (self._listen, self._follow_people, self._find_tokens)
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stop listening."""
        self._closed.set()
        self._threads[-1].join()
        self._planner.close()
        self._client.close()

    def begin(self, expected: Report | None = None) -> Snapshot:
        """Wait until all people are tracked for a while, start again, and return the state."""
        with self._arrived:
            self.positions_m = {}
        self.wait(lambda: bool(self.positions_m) and self.healths.keys() >= self._pids.keys())
        self._restart()
        self.wait_for_people(CALM)
        self.calm_s = self.longest_pause_s()
        self.discontent_before = self.discontent()
        self._restart()
        with self._arrived:
            self._expected, self.reported_s = expected or Report(), {}
            self._counted = self.count_of(self._expected)
        return self.snapshot()

    def snapshot(self) -> Snapshot:
        """Return the state."""
        pids = self.system.pids()
        memory_mb = {n: psutil.Process(pid).memory_info().rss / 2**20 for n, pid in pids.items()}
        errors = sum(health.counters.get("errors", 0) for health in self.healths.values())
        return Snapshot(pids, memory_mb, self.positions_m, errors)

    def wait(self, condition: Callable[[], bool]) -> None:
        """Wait for a condition on what was received."""
        with self._arrived:
            if not self._arrived.wait_for(condition, WAIT_S):
                reasons = {name: (h.state, h.reason) for name, h in self.healths.items()}
                raise TimeoutError(f"people {self.positions_m}, {reasons}")

    def wait_for_people(self, count: int = 3) -> None:
        """Wait for more messages with all people."""
        enough = len(self.arrivals_s) + count
        self.wait(lambda: len(self.arrivals_s) >= enough)

    def longest_pause_s(self) -> float:
        """Return the longest time without people since `begin`."""
        return max(b - a for a, b in pairwise(self.arrivals_s))

    def wait_for_report(self) -> None:
        """Wait until the whole expected report has arrived."""
        self.wait(lambda: self.reported_s.keys() >= self._expected.parts)

    def count_of(self, report: Report) -> int:
        """Return the counter of a report in the last heartbeat."""
        health = self.healths.get(f"{report.service}-1")
        return health.counters.get(report.counter, 0) if health and report.counter else 0

    def refusals(self) -> int:
        """Return the number of messages refused as bad by all processes since their start."""
        with self._arrived:
            return sum(
                count
                for health in self.healths.values()
                for name, count in health.counters.items()
                if name.startswith("bad_")
            )

    def discontent(self) -> set[str]:
        """Return the checks of the doctor that report problems since `begin`."""
        with self._arrived:
            return {d.check for d in examine(self.evidence) if d.level != "ok"}

    def _restart(self) -> None:
        with self._arrived:
            self.evidence = Evidence(robot=ROBOT, present=self.evidence.present)
            self._started_s = time.monotonic()
            self.arrivals_s = self.arrivals_s[-1:]
            self.identities = set(self.positions_m)

    def _listen(self) -> None:
        for message in self._client.messages(*HEARD):
            with self._arrived:
                self.evidence.elapsed_s = time.monotonic() - self._started_s
                self._take(message)
                self._arrived.notify_all()

    def _follow_people(self) -> None:
        for message in self._planner.messages(Tracks):
            if isinstance(message, Tracks) and message.camera == CAMERA and message.trace:
                with self._arrived:
                    self._take_people(message, time.monotonic())
                    self._arrived.notify_all()

    def _find_tokens(self) -> None:
        while not self._closed.wait(TOKENS_S):
            present = self._client.session.present()
            with self._arrived:
                self.evidence.present = present

    def _note_report(self) -> None:
        """Record the parts of the expected report that have arrived."""
        expected = self._expected
        reasons = "; ".join(health.reason for health in self.healths.values())
        found = {
            "counter": self.count_of(expected) > self._counted,
            "reason": expected.reason in reasons,
        }
        if "check" in expected.parts - self.reported_s.keys():
            found["check"] = expected.check in self.discontent()
        for part in expected.parts:
            if found.get(part):
                self.reported_s.setdefault(part, time.monotonic())

    def _take(self, message: Message) -> None:
        self.evidence.add_message(message, time.time_ns())
        if isinstance(message, Health) and self._pids.get(message.instance) == message.pid:
            self.healths[message.instance] = message
            self._note_report()

    def _take_people(self, tracks: Tracks, now_s: float) -> None:
        people = {t.id: t.position_m for t in tracks.tracks if t.state == "confirmed"}
        self.identities |= people.keys()
        if len(people) == PEOPLE:
            self.positions_m = people
            self.arrivals_s.append(now_s)


def same_people(before: dict[int, F64], after: dict[int, F64]) -> bool:
    """Check that all people have unchanged positions and identities."""
    return before.keys() == after.keys() and all(
        np.linalg.norm(before[i] - after[i]) < NEAR_M for i in before
    )


def begin_of(process: "subprocess.Popen[bytes]") -> float:
    """Return the monotonic time at which an attack begins, once it does."""
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:  # it ended: `communicate` has the reason
        return time.monotonic()
    return float(line)


@contextmanager
def attacking(
    observer: Observer, name: str, *arguments: str
) -> Iterator["subprocess.Popen[bytes]"]:
    """Run an attack in a process that cannot import the project."""
    command = [sys.executable, "-P", str(ATTACKER), observer.system.connect, ROBOT, name]
    pipe = subprocess.PIPE
    process = subprocess.Popen([*command, *arguments], cwd="/", stdout=pipe, stderr=pipe)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()
