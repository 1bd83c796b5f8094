"""Our commands on three hosts, and what is heard on each."""

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from scripts.namespaces import ADDRESSES, Hosts, stop

ROOT = Path(__file__).resolve().parents[3]
CONFIGS = ROOT / "deploy" / "hosts"
ROUTER = f"tcp/{ADDRESSES['nuc']}:7447"
PEOPLE4D = str(Path(sys.executable).with_name("people4d"))
TIMEOUT_S = 60.0


@dataclass(frozen=True)
class Heard:
    """One message as a host heard it.

    Args:
        arrived_s: Wall clock when its bytes were there.
        sequence: Its number.
        sent_s: Wall clock at the end of its trace.
        size: Bytes of an image, 0 of people.
        stages_ms: Durations of its way by "<service>.<stage>".
    """

    arrived_s: float
    sequence: int
    sent_s: float
    size: int
    stages_ms: Mapping[str, float] = field(default_factory=dict)

    @property
    def hop_ms(self) -> float:
        """Time from the sender's hands to the listener's."""
        return (self.arrived_s - self.sent_s) * 1e3


class Site:
    """Our commands on the three hosts.

    Args:
        world: The hosts.
        folder: For keys, state and what is heard.
    """

    def __init__(self, world: Hosts, folder: Path) -> None:
        self.world = world
        self._folder = folder
        self._open = contextlib.ExitStack()
        made = [PEOPLE4D, "keys", str(folder / "keys"), "--router", ADDRESSES["nuc"]]
        subprocess.run(made, check=True, capture_output=True)

    def environment(self, host: str, keys: str = "") -> dict[str, str]:
        """Return the variables of a host, as docs/launch/hosts.md has a user set them."""
        remote = {} if host == "nuc" else {"PEOPLE4D_CONNECT": ROUTER}
        return {
            **os.environ,
            "OMP_NUM_THREADS": "1",
            "PEOPLE4D_STATE": str(self._folder / f"state-{host}"),
            "PEOPLE4D_KEYS": str(self._folder / "keys" / (keys or host)),
            **remote,
        }

    def up(self, host: str, *arguments: str) -> None:
        """Start what runs on a host; it ends with the block."""
        command = [PEOPLE4D, "up", "--compose", str(CONFIGS / f"{host}.yaml"), "-d", *arguments]
        self._open.callback(self.down, host)
        try:
            self.world.run(host, command, env=self.environment(host))
        except subprocess.CalledProcessError as error:
            raise RuntimeError(f"{host}: {error.stdout}{error.stderr}") from error

    def down(self, host: str) -> None:
        """Stop what runs on a host."""
        self.world.run(host, [PEOPLE4D, "down"], env=self.environment(host))

    @contextlib.contextmanager
    def listening(self, host: str, topic: str = "people", role: str = "") -> Iterator["Log"]:
        """Write down what a host hears until the block ends.

        Args:
            host: The host.
            topic: What it listens to.
            role: Whose credentials it uses, those of the router's host; empty: its own.
        """
        log = Log(self._folder / f"{host}-{topic}-{time.monotonic_ns()}.jsonl")
        with self._ours(host, role, "--listen", topic, str(log.file)):
            log.wait_for_more()
            yield log

    @contextlib.contextmanager
    def sending(self, host: str, topic: str, rate_hz: float) -> Iterator[None]:
        """Publish messages of usual size from a host until the block ends."""
        with self._ours(host, "", "--send", topic, str(rate_hz)):
            yield

    @contextlib.contextmanager
    def router(self) -> Iterator[None]:
        """Run the router alone until the block ends."""
        listen = {"PEOPLE4D_LISTEN": "tcp/0.0.0.0:7447"}
        command = [sys.executable, "-m", "services.router"]
        with self._running("nuc", command, self.environment("nuc") | listen):
            yield

    @contextlib.contextmanager
    def _ours(self, host: str, role: str, *arguments: str) -> Iterator[None]:
        environment = self.environment(host, "nuc" if role else "")
        environment |= {"PEOPLE4D_CONNECT": ROUTER, "PEOPLE4D_ROLE": role}
        command = [sys.executable, "-m", "benchmarks.hosts", *arguments]
        with self._running(host, command, environment):
            yield

    @contextlib.contextmanager
    def _running(
        self, host: str, command: Sequence[str], environment: Mapping[str, str]
    ) -> Iterator[None]:
        with (self._folder / f"{host}.log").open("a", encoding="utf-8") as log:
            process = self.world.start(
                host, command, env=environment, cwd=ROOT, stdout=log, stderr=log
            )
            try:
                yield
            finally:
                stop(process)

    def close(self) -> None:
        """Stop everything."""
        self._open.close()


class Log:
    """Messages received by a host, line by line.

    Args:
        file: Where the listener writes.
    """

    def __init__(self, file: Path) -> None:
        self.file = file

    def read(self) -> list[Heard]:
        """Return all that was heard so far."""
        if not self.file.exists():
            return []
        text = self.file.read_text(encoding="utf-8")
        return [Heard(**json.loads(line)) for line in text[: text.rfind("\n") + 1].splitlines()]

    def between(self, begin_s: float, end_s: float) -> list[Heard]:
        """Return what arrived in a time."""
        return [heard for heard in self.read() if begin_s <= heard.arrived_s < end_s]

    def wait_for_more(self, than: int = 0) -> list[Heard]:
        """Wait until more messages were heard than a number."""
        end_s = time.monotonic() + TIMEOUT_S
        while len(heard := self.read()) <= than:
            if time.monotonic() > end_s:
                raise TimeoutError(f"nothing more is heard: {self.file.name}")
            time.sleep(0.05)
        return heard
