"""Cost of a fault: each service killed, and hung, while three people are tracked.

The system runs as `people4d up` starts it, with frames at 15 Hz of three standing people. A
service is killed (SIGKILL) or made to hang (SIGSTOP) repeatedly, while a client listens through the
router. Back: from the signal to the first heartbeat of the service's next process that works.
Silence: the longest pause between two messages with confirmed tracks. Lost: frames without an
answer in that pause, and outside it. Kept: cases in which all people had the same identity
afterwards.
"""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.system.standing import PEOPLE, RATE_HZ
from benchmarks.lib.table import markdown, spread, write
from common.transport.ports import free_port
from deploy.launcher.health import works
from deploy.launcher.launcher import stop
from deploy.launcher.state import State
from deploy.launcher.supervisor import Supervisor
from people4d.client import Client
from people4d.messages import Health, Message, Tracks

STARTS = (
    "deploy.cli.system.up",
    "deploy.launcher.prefork",
    "services.camera.__main__",
    "services.detector.__main__",
    "services.reid.__main__",
    "services.tracker.__main__",
    "services.router.__main__",
)
ROBOT = "faults"
SERVICES = ("detector", "reid", "tracker", "camera", "router")
SIGNALS = {signal.SIGKILL: "killed", signal.SIGSTOP: "hung"}
LONGEST_S = 40.0
SETTLE_S = 2.0  # duration of undisturbed work before and after a fault [s]
FEW = 4  # minimum number of messages in that time, for slow machines
NEAR_M = 0.8  # maximum distance of a standing person from the known position [m]


@dataclass
class ReceivedTracks:
    """A message about people with its time of arrival."""

    at_s: float
    tracks: Tracks

    @property
    def current_m(self) -> dict[int, np.ndarray]:
        """Positions of confirmed tracks by identity."""
        people = self.tracks.tracks
        return {p.id: p.position_m[:2] for p in people if p.state == "confirmed"}


class Ear:
    """Receives messages of a system through its router, in a thread of its own."""

    def __init__(self, connect: str, robot: str = ROBOT) -> None:
        self.received: list[ReceivedTracks] = []
        self._health: dict[str, Health] = {}
        self._client = Client(connect, robot, 20.0)
        self._arrived = threading.Condition()
        threading.Thread(target=self._listen, daemon=True).start()

    def wait(self, want: Callable[[], bool], longest_s: float = LONGEST_S) -> float | None:
        """Wait for a condition; return the time at which it became true, None after the timeout."""
        with self._arrived:
            return time.monotonic() if self._arrived.wait_for(want, longest_s) else None

    def works_again(self, service: str, pid: int) -> bool:
        """Check that another process than `pid` reports `ready`."""
        health = self._health.get(service)
        return health is not None and works(health) and health.pid != pid

    def close(self) -> None:
        """Stop listening."""
        self._client.close()

    def _listen(self) -> None:
        for message in self._client.messages(Tracks, Health):
            with self._arrived:
                self._take(message, time.monotonic())
                self._arrived.notify_all()

    def _take(self, message: Message, now_s: float) -> None:
        if isinstance(message, Health):
            self._health[message.service] = message
        elif isinstance(message, Tracks):
            self.received.append(ReceivedTracks(now_s, message))


@dataclass
class Fault:
    """Cost of one fault."""

    back_s: float | None  # [s] time until the service works again; None: not in time
    silence_s: float  # [s] maximum interval between messages with confirmed tracks
    lost: int  # number of frames without an answer in that interval
    beyond: int  # number of other frames without an answer
    identities_same: bool  # True if all identities are the same afterwards


@dataclass
class Ledger:
    """Identities and positions of people over a run."""

    positions_m: dict[int, np.ndarray] = field(default_factory=dict)
    twice: set[int] = field(default_factory=set)

    def add_identities(self, current_m: dict[int, np.ndarray]) -> None:
        """Add identities; count identities twice at different positions."""
        for identity, position_m in current_m.items():
            before = self.positions_m.setdefault(identity, position_m)
            if np.linalg.norm(before - position_m) > NEAR_M:
                self.twice.add(identity)


def main() -> None:
    asked = options.parser(__doc__, "rounds", "quick").parse_args()
    times = 1 if asked.quick else asked.rounds
    with tempfile.TemporaryDirectory(prefix="p4d") as folder:
        faults, ledger = measure(Path(folder), times)
    table = rows(faults)
    header = ("service", "fault", "back [s]", "silence [s]", "lost in it", "lost outside", "kept")
    ids = (
        f"{len(ledger.positions_m)} identities were given in all, {len(ledger.twice)} of them to "
        "more than one person."
    )
    text = (__doc__ or "").partition("\n\n")[2]
    note = f"Medians with minimum and maximum of {times} faults each."
    parts = (text.strip(), note, markdown(header, table), ids)
    write(__file__, "Effects of faults", *parts, dry=asked.quick)


def measure(folder: Path, times: int) -> tuple[dict[tuple[str, str], list[Fault]], Ledger]:
    """Start the system, cause faults repeatedly, and stop it."""
    state, port = State(folder / ROBOT), free_port()
    command = [sys.executable, "-m", "deploy.cli", "up", "--detach", "--robot", ROBOT]
    command += ["--port", str(port), "--source", "benchmarks.lib.system.standing:Standing"]
    root = Path(__file__).resolve().parents[1]
    environment = {**os.environ, "PEOPLE4D_STATE": str(folder), "PYTHONPATH": str(root)}
    subprocess.run(command, env=environment, check=True, cwd=root)
    faults: dict[tuple[str, str], list[Fault]] = {}
    ledger, ear = Ledger(), Ear(f"tcp/127.0.0.1:{port}")
    try:
        for _ in range(times):
            for number, name in SIGNALS.items():
                for service in SERVICES:
                    fault = once(ear, ledger, Supervisor(state), service, number)
                    print(service, name, fault, flush=True)
                    faults.setdefault((service, name), []).append(fault)
    finally:
        ear.close()
        stop(state)
    return faults, ledger


def once(
    ear: Ear, ledger: Ledger, supervisor: Supervisor, service: str, number: signal.Signals
) -> Fault:
    """Cause a fault of a service while all people are tracked, and wait for its end."""
    wait_for_people(ear)
    before = ear.received[-1].current_m
    pid = supervisor.processes()[f"{service}-1"].pid
    start, start_s = len(ear.received) - 1, time.monotonic()
    os.kill(pid, number)
    back_s = ear.wait(lambda: ear.works_again(service, pid))
    wait_for_people(ear, since_s=time.monotonic())
    received = [t for t in ear.received[start:] if t.current_m]
    for one in received:
        ledger.add_identities(one.current_m)
    pauses = [(b.at_s - a.at_s, unanswered(a, b)) for a, b in pairwise(received)]
    silence_s, lost = max(pauses, default=(0.0, 0))
    return Fault(
        back_s=None if back_s is None else back_s - start_s,
        silence_s=silence_s,
        lost=lost,
        beyond=sum(count for _, count in pauses) - lost,
        identities_same=same(before, received[-1].current_m),
    )


def wait_for_people(ear: Ear, since_s: float = 0.0) -> None:
    """Wait until every message of a period of SETTLE_S after `since_s` holds all people."""

    def well() -> bool:
        begin_s = time.monotonic() - SETTLE_S
        lately = [t for t in ear.received if t.at_s > begin_s]
        complete = len(lately) >= FEW and all(len(t.current_m) == PEOPLE for t in lately)
        return complete and begin_s >= since_s

    if ear.wait(well) is None:
        raise TimeoutError("people are not tracked any more")


def unanswered(a: ReceivedTracks, b: ReceivedTracks) -> int:
    """Return the number of frames without an answer between two messages."""
    step = b.tracks.sequence - a.tracks.sequence
    if step < 0:  # a restarted camera counts from 0: frames it would have sent
        step = round((b.at_s - a.at_s) * RATE_HZ)
    return max(step - 1, 0)


def same(before: dict[int, np.ndarray], after: dict[int, np.ndarray]) -> bool:
    """Check that the same identities are at the same positions."""
    return before.keys() == after.keys() and all(
        np.linalg.norm(before[i] - after[i]) < NEAR_M for i in before
    )


def rows(faults: dict[tuple[str, str], list[Fault]]) -> list[list[str]]:
    """Return one row for each service and kind of fault."""
    table = []
    for (service, name), found in faults.items():
        back = [f.back_s for f in found if f.back_s is not None]
        missing = "" if len(back) == len(found) else f", {len(found) - len(back)} not back"
        table.append(
            [
                service,
                name,
                (spread(back, "{:.1f}") if back else "never") + missing,
                spread([f.silence_s for f in found]),
                spread([f.lost for f in found], "{:.0f}"),
                spread([f.beyond for f in found], "{:.0f}"),
                f"{sum(f.identities_same for f in found)} of {len(found)}",
            ]
        )
    return table
