"""A complete system on the shipped recording, started by people4d up, for tests that break it."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from common.transport.ports import free_port
from common.transport.zenoh_bus import ZenohBus, read_config
from deploy.cli.system.demo import DEMO
from deploy.launcher.health import works
from deploy.launcher.launcher import stop
from deploy.launcher.state import State
from deploy.launcher.supervisor import Supervisor
from people4d.messages import Health, Tracks
from tests import ROOT
from tests.network import WAIT_S, Watcher

ROBOT = "broken"
START_TIMEOUT_S = 110.0
SLOWLY = ("--loop", "--set", "camera.stride=3")  # five frames a second, without end


class System:
    """A running system and its messages through its router."""

    def __init__(self, state: State, connect: str) -> None:
        self.connect = connect
        self._supervisor = Supervisor(state)
        self._bus = ZenohBus(read_config(None, "client", {"PEOPLE4D_CONNECT": connect}), ROBOT, 5.0)

    def watch(self, *kinds: type) -> Watcher:
        """Listen from now on."""
        return Watcher(self._bus, *kinds)

    def pid(self, service: str) -> int:
        """Return the process number of a service, 0 while it does not run."""
        return self._supervisor.processes()[f"{service}-1"].pid

    def pids(self) -> dict[str, int]:
        """Return the process numbers of all services by instance."""
        return {name: p.pid for name, p in self._supervisor.processes().items()}

    def signal(self, service: str, number: signal.Signals) -> int:
        """Send a signal to a service; return its process number."""
        pid = self.pid(service)
        os.kill(pid, number)
        return pid

    def wait_alive(self, instance: str) -> None:
        """Wait until other processes know of an instance: its token spreads after it is ready."""
        end_s = time.monotonic() + WAIT_S
        while instance not in {name for robot, _, name in self._bus.present() if robot == ROBOT}:
            assert time.monotonic() < end_s, f"{instance} is not known"

    def close(self) -> None:
        """Stop listening."""
        self._bus.close()


def up(
    folder: Path, port: int, *arguments: str, source: str = str(DEMO)
) -> subprocess.CompletedProcess[str]:
    """Run people4d up until it returns."""
    command = [sys.executable, "-m", "deploy.cli", "up", "--detach"]
    own = {"PEOPLE4D_STATE": str(folder), "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [*command, "--robot", ROBOT, "--port", str(port), "--source", source, *arguments],
        env={**os.environ, **own},
        capture_output=True,
        text=True,
        timeout=START_TIMEOUT_S,
        check=False,
    )


@contextmanager
def running(folder: Path, *arguments: str, source: str = str(DEMO)) -> Iterator[System]:
    """Start the system; everything has ended after the block."""
    port, state = free_port(), State(folder / ROBOT)
    try:
        done = up(folder, port, *arguments, source=source)
        assert done.returncode == 0, done.stderr
        system = System(state, f"tcp/127.0.0.1:{port}")
        try:
            yield system
        finally:
            system.close()
    finally:
        stop(state)


def seconds(wait: Callable[[], object]) -> float:
    """Return how long a wait took [s]."""
    begin_s = time.monotonic()
    wait()
    return time.monotonic() - begin_s


def shows_people(tracks: Tracks) -> bool:
    """Return True if a message has a person detected in its frame."""
    return any(person.state == "confirmed" for person in tracks.tracks)


def predicted(tracks: Tracks) -> bool:
    """Return whether a message was made without a frame; where frames are slow it is empty."""
    return tracks.predicted


def works_again(service: str, pid: int) -> Callable[[Health], bool]:
    """Return a predicate: a heartbeat of the service, healthy, from another process."""
    return lambda h: h.service == service and works(h) and h.pid != pid
