"""Chaos: random faults of all kinds for half an hour, while people are followed.

The system runs as `people4d up` starts it, with frames at 15 Hz of three people who stand.
Processes are killed (SIGKILL) and stopped (SIGSTOP), the clock of the camera is set, others use the
processor without end, subscribe to everything and stop reading, flood the bus with garbage,
invented heartbeats or embeddings of frames that do not exist, and the link of an outside client is
cut. What is done and when follows from the seed alone; disturbances may overlap. A subscriber
listens through the router all the time.

Without people: the longest pause between two messages that hold people seen in a frame, from the
disturbance on until the next one. An id is lost when somebody who stands has another one than
before; it counts for the last disturbance. Outside: time from the end of a network cut until
people came again through the link.
"""

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.faults import NEAR_M, Ear, ReceivedTracks, wait_for_people
from benchmarks.lib.chaos.actions import Saboteur
from benchmarks.lib.chaos.plan import Disturbance, plan
from benchmarks.lib.chaos.tcp_proxy import TcpProxy
from benchmarks.lib.system.growth import slope, written_mb
from benchmarks.lib.system.standing import CLOCK_VARIABLE
from benchmarks.lib.table import markdown, spread, write
from common.transport.ports import free_port
from deploy.launcher.launcher import stop
from deploy.launcher.state import State
from deploy.launcher.supervisor import Supervisor, SupervisorGoneError

ROBOT = "chaos"
MEMORY_S = 5.0  # between two samples
START_S = "240"
WORST = 10  # disturbances that are listed
ROOT = Path(__file__).resolve().parents[1]


@dataclass
class Outcome:
    """Consequences of one disturbance."""

    what: Disturbance
    silence_s: float  # [s] longest pause of people seen
    lost_ids: int
    outside_s: float | None = None  # [s] until an outside client heard again; None: never


@dataclass
class Memory:
    """Memory of one service's processes over a run."""

    times_s: list[float] = field(default_factory=list)
    used_mb: list[float] = field(default_factory=list)
    pids: list[int] = field(default_factory=list)  # one after the other


class Follower:
    """Identities of people who stand, by where they stand.

    Args:
        first: People at the beginning.
    """

    def __init__(self, first: ReceivedTracks) -> None:
        self._positions_m = list(first.current_m.values())
        self.ids = list(first.current_m)
        self.changes: list[float] = []  # when somebody had another identity than before

    def follow(self, one: ReceivedTracks) -> None:
        """Compare with the last identities; who is not seen in a message keeps the last one."""
        for index, position_m in enumerate(self._positions_m):
            near = {
                identity: float(np.linalg.norm(found_m - position_m))
                for identity, found_m in one.current_m.items()
                if identity == self.ids[index] or identity not in self.ids
            }
            near = {identity: metres for identity, metres in near.items() if metres < NEAR_M}
            if near and self.ids[index] not in near:
                self.ids[index] = min(near, key=lambda i: near[i])
                self.changes.append(one.at_s)


class MemoryObserver:
    """Samples the memory of all processes of a system in a thread of its own."""

    def __init__(self, supervisor: Supervisor) -> None:
        self.services: dict[str, Memory] = {}
        self._supervisor, self._closed = supervisor, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End."""
        self._closed.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._closed.wait(MEMORY_S):
            with contextlib.suppress(SupervisorGoneError):
                for name, process in self._supervisor.processes().items():
                    self._sample(self.services.setdefault(name, Memory()), process.pid)

    def _sample(self, memory: Memory, pid: int) -> None:
        with contextlib.suppress(OSError, KeyError):  # it has just ended
            used_mb = written_mb(pid) if pid else 0.0
            if used_mb:
                memory.times_s.append(time.monotonic())
                memory.used_mb.append(used_mb)
                if pid not in memory.pids[-1:]:
                    memory.pids.append(pid)


@dataclass
class Result:
    """Results of a run."""

    outcomes: list[Outcome]
    memory: dict[str, Memory]
    longest_s: float  # [s] without people, over the whole time
    first_ids: int  # number of people at the beginning
    people_at_end: int  # and of those seen at the end
    messages: int


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--plan", action="store_true", help="print what would be done, and end")
    parser.add_argument("--quick", action="store_true", help="no file written")
    options = parser.parse_args()
    planned = plan(options.seed, options.minutes)
    if options.plan:
        print(*planned, sep="\n")
        return
    with tempfile.TemporaryDirectory(prefix="p4d") as folder:
        result = run(Path(folder), planned, options.minutes * 60)
    parts = report(result)
    if options.quick:
        print(*parts, sep="\n\n")
        return
    text = (__doc__ or "").partition("\n\n")[2].strip()
    title = f"Chaos: {options.minutes:g} minutes, seed {options.seed}"
    write(__file__, title, text, *parts)


@contextlib.contextmanager
def system(folder: Path) -> Iterator[tuple[State, str, Path]]:
    """Start the system; yield its state, its router's endpoint and its camera's clock."""
    state, port, clock = State(folder / ROBOT), free_port(), folder / "clock"
    clock.write_text("0")
    command = [sys.executable, "-m", "deploy.cli", "up", "--detach", "--robot", ROBOT]
    command += ["--port", str(port), "--source", "benchmarks.lib.system.standing:Standing"]
    command += ["--timeout", START_S]
    environment = {**os.environ, "PEOPLE4D_STATE": str(folder), "PYTHONPATH": str(ROOT)}
    environment[CLOCK_VARIABLE] = str(clock)
    subprocess.run(command, env=environment, check=True, cwd=ROOT)
    try:
        yield state, f"tcp/127.0.0.1:{port}", clock
    finally:
        stop(state)


def run(folder: Path, planned: Sequence[Disturbance], duration_s: float) -> Result:
    """Disturb a system by plan."""
    with contextlib.ExitStack() as stack:
        state, endpoint, clock = stack.enter_context(system(folder))
        supervisor = Supervisor(state)
        proxy = stack.enter_context(TcpProxy(int(endpoint.rpartition(":")[2])))
        ear = Ear(endpoint, ROBOT)
        stack.callback(ear.close)
        outside = Ear(proxy.endpoint, ROBOT)
        stack.callback(outside.close)
        wait_for_people(ear)
        follower = Follower(ear.received[-1])
        first = len(ear.received)
        environment = {**os.environ, "PEOPLE4D_CONNECT": endpoint, "PEOPLE4D_ROBOT": ROBOT}
        saboteur = Saboteur(supervisor, environment, proxy, clock)
        stack.callback(saboteur.close)
        memory = MemoryObserver(supervisor)
        stack.callback(memory.close)
        begin_s = time.monotonic()
        times_s: list[float] = []
        for what in planned:
            time.sleep(max(0.0, begin_s + what.at_s - time.monotonic()))
            print(what, flush=True)
            times_s.append(time.monotonic())
            saboteur.disturb(what)
        time.sleep(max(0.0, begin_s + duration_s - time.monotonic()))
        end_s = time.monotonic()
        received = ear.received[first:]
        for one in received:
            follower.follow(one)
        pauses = [(a, b) for a, b in pairwise(_times_with_people(received, begin_s, end_s))]
        return Result(
            outcomes=_outcomes(planned, [*times_s, end_s], pauses, follower, outside),
            memory=memory.services,
            longest_s=max(b - a for a, b in pauses),
            first_ids=len(follower.ids),
            people_at_end=len(received[-1].current_m),
            messages=len(received),
        )


def _times_with_people(
    received: Sequence[ReceivedTracks], begin_s: float, end_s: float
) -> list[float]:
    return [begin_s, *(one.at_s for one in received if one.current_m), end_s]


def _outcomes(
    planned: Sequence[Disturbance],
    times_s: Sequence[float],
    pauses: Sequence[tuple[float, float]],
    follower: Follower,
    outside: Ear,
) -> list[Outcome]:
    """Return what each disturbance cost; the last time is that of the end."""
    outcomes = []
    for what, (start_s, next_s) in zip(planned, pairwise(times_s), strict=True):
        # A pause counts for the disturbance in whose time most of it lies.
        during = [b - a for a, b in pauses if start_s <= (a + b) / 2 < next_s]
        lost = sum(start_s <= at_s < next_s for at_s in follower.changes)
        outcome = Outcome(what, max(during, default=0.0), lost)
        if what.kind == "network cut":
            restored_s = start_s + what.duration_s
            heard = (t.at_s - restored_s for t in outside.received if t.at_s > restored_s)
            outcome.outside_s = next(heard, None)
        outcomes.append(outcome)
    return outcomes


def report(result: Result) -> list[str]:
    """Return the tables."""
    outcomes = result.outcomes
    lost = sum(o.lost_ids for o in outcomes)
    summary = (
        f"{len(outcomes)} disturbances, {result.messages} messages about people. Longest time "
        f"without people: {result.longest_s:.1f} s. Ids lost: {lost}, of {result.first_ids} people "
        f"in {len(outcomes)} disturbances. People seen at the end: {result.people_at_end}."
    )
    worst = sorted(outcomes, key=lambda o: (o.lost_ids, o.silence_s), reverse=True)[:WORST]
    return [
        summary,
        "## By kind",
        markdown(
            ["disturbance", "times", "without people [s]", "ids lost", "outside [s]"],
            [_row(name, group) for name, group in _groups(outcomes).items()],
        ),
        "## The worst",
        markdown(
            ["at [s]", "disturbance", "without people [s]", "ids lost"],
            [[*_where(o.what), f"{o.silence_s:.1f}", f"{o.lost_ids}"] for o in worst],
        ),
        "## Memory",
        "Memory that each service's processes, one after the other, have written: median with "
        "least and most, and the slope of Theil and Sen over medians of a minute with its interval "
        "by block bootstrap.",
        markdown(
            ["process", "started", "memory [MB]", "slope [MB/h] (95 %)"],
            [_memory_row(name, memory) for name, memory in sorted(result.memory.items())],
        ),
    ]


def _groups(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    groups: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        groups.setdefault(f"{outcome.what.kind}: {outcome.what.target}", []).append(outcome)
    return dict(sorted(groups.items()))


def _row(name: str, group: Sequence[Outcome]) -> list[str]:
    outside = [o.outside_s for o in group if o.outside_s is not None]
    never = sum(o.outside_s is None for o in group) if "cut" in name else 0
    heard = (spread(outside, "{:.1f}") if outside else "") + (f", {never} never" if never else "")
    silences = [o.silence_s for o in group]
    lost = sum(o.lost_ids for o in group)
    return [name, f"{len(group)}", spread(silences, "{:.1f}"), f"{lost}", heard]


def _where(what: Disturbance) -> list[str]:
    at, _, rest = str(what).strip().partition(" s  ")
    return [at, rest]


def _memory_row(name: str, memory: Memory) -> list[str]:
    rise = "too short"
    if memory.times_s[-1] - memory.times_s[0] > 2 * 60:
        middle, low, high = slope(memory.times_s, memory.used_mb)
        rise = f"{middle:+.0f} ({low:+.0f} to {high:+.0f})"
    return [name, f"{len(memory.pids)}", spread(memory.used_mb, "{:.0f}"), rise]


if __name__ == "__main__":
    main()
