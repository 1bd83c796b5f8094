"""Disturbances of a running system, each undone after its time.

`python -m benchmarks.lib.chaos.actions flood KIND` and `... read` are the processes of others.
"""

import contextlib
import os
import secrets
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import zenoh

from benchmarks.lib.chaos.plan import Disturbance
from benchmarks.lib.chaos.tcp_proxy import TcpProxy
from common.transport.zenoh_bus import read_config
from deploy.launcher.supervisor import Supervisor
from people4d.codec import encode
from people4d.messages import Embeddings, Health
from people4d.topics import BY_MESSAGE, TOPICS

FLOOD_HZ = 200.0
GARBAGE_BYTES = 20_000
DIMENSIONS = 512


class Saboteur:
    """Disturbs a system.

    Args:
        supervisor: Of the system.
        environment: Variables with which others reach it.
        proxy: Link of an outside client.
        clock: File with the step of the camera's clock.
    """

    def __init__(
        self, supervisor: Supervisor, environment: dict[str, str], proxy: TcpProxy, clock: Path
    ) -> None:
        self._supervisor, self._proxy, self._clock = supervisor, proxy, clock
        self._environment = environment
        self._step_s = 0.0
        self._undo: list[threading.Timer] = []
        self._others: list[subprocess.Popen[bytes]] = []

    def disturb(self, what: Disturbance) -> None:
        """Do one thing; it ends by itself after its time."""
        match what.kind:
            case "kill":
                self._signal(what.target, signal.SIGKILL)
            case "stop":
                pid = self._signal(what.target, signal.SIGSTOP)
                self._after(what.duration_s, lambda: _signal(pid, signal.SIGCONT))
            case "clock step":
                self._step_s += float(what.target)
                new = self._clock.with_suffix(".new")
                new.write_text(str(self._step_s))
                new.rename(self._clock)  # never half written
            case "overload":
                for _ in range(int(what.target)):
                    self._start(what.duration_s, "-c", "while True: pass")
            case "stuck reader":
                reader = self._start(what.duration_s, "-m", __name__, "read")
                self._after(1.0, lambda: _signal(reader.pid, signal.SIGSTOP))
            case "network cut":
                self._proxy.cut(reset=what.target == "reset")
                self._after(what.duration_s, self._proxy.restore)
            case "flood":
                self._start(what.duration_s, "-m", __name__, "flood", what.target)

    def close(self) -> None:
        """Undo all at once."""
        for timer in self._undo:
            timer.cancel()
            timer.function()
        for process in self._others:
            process.wait()

    def _signal(self, service: str, number: signal.Signals) -> int:
        pid = self._supervisor.processes()[f"{service}-1"].pid
        _signal(pid, number)
        return pid

    def _start(self, duration_s: float, *arguments: str) -> "subprocess.Popen[bytes]":
        process = subprocess.Popen([sys.executable, *arguments], env=self._environment)
        self._others.append(process)
        self._after(duration_s, process.kill)
        return process

    def _after(self, duration_s: float, do: Callable[[], object]) -> None:
        timer = threading.Timer(duration_s, do)
        timer.daemon = True
        timer.start()
        self._undo.append(timer)


def _signal(pid: int, number: signal.Signals) -> None:
    if pid > 0:  # 0: it is being started
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def read(session: zenoh.Session) -> None:
    """Subscribe to everything and take it, until stopped."""
    for _ in session.declare_subscriber("people4d/**"):
        pass


def flood(session: zenoh.Session, robot: str, kind: str) -> None:
    """Publish what no service sends, until killed."""
    for key, payload in _messages(kind, np.random.default_rng(0), robot):
        session.put(key, payload)
        time.sleep(1 / FLOOD_HZ)


def _messages(kind: str, chance: np.random.Generator, robot: str) -> Iterator[tuple[str, bytes]]:
    number = 0
    while True:
        number += 1
        if kind == "garbage":
            for topic in TOPICS:
                key = topic.key_expression(robot).replace("*", "front")
                yield key, secrets.token_bytes(GARBAGE_BYTES)
        elif kind == "heartbeats":
            invented = Health(
                stamp_ns=time.time_ns(),
                sequence=number,
                trace=(),
                service="detector",
                instance=f"invented-{number}",
                host="elsewhere",
                pid=number,
                state="stalled",
                reason="x" * 1000,
            )
            yield BY_MESSAGE[Health].key_of(invented, robot), encode(invented)
        else:
            vectors = chance.normal(size=(20, DIMENSIONS)).astype(np.float32)
            vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
            unknown = Embeddings(
                stamp_ns=time.time_ns() + number,
                sequence=number,
                trace=(),
                camera="front",
                model="histogram",
                detections=tuple(range(20)),
                vectors=vectors,
            )
            yield BY_MESSAGE[Embeddings].key_of(unknown, robot), encode(unknown)


def main() -> None:
    """Be one of the others."""
    with zenoh.open(read_config(None, "client")) as session:
        if sys.argv[1] == "read":
            read(session)
        else:
            flood(session, os.environ["PEOPLE4D_ROBOT"], sys.argv[2])


if __name__ == "__main__":
    main()
