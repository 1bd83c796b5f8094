"""Every listening socket of a running system is documented, and reached from this machine only."""

import ipaddress
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from tests import ROOT
from tests.integration.system import ROBOT, running

pytestmark = [pytest.mark.processes, pytest.mark.network, pytest.mark.timeout(300)]

PAGE = ROOT / "docs" / "operation" / "security.md"
ROW = re.compile(r"^\| ([\w -]+) \| (\d+) \|", re.MULTILINE)
EVERYTHING = ("--dashboard", "--ros2", "zenoh", "--predict", "--skeletons", "--gait", "--events")
SERVERS = {
    "export --prometheus": ("export", "--prometheus", "0"),
    "view --foxglove": ("view", "--foxglove", "--port", "0"),
}


def documented(process: str) -> int:
    """Return the number of sockets of a process in the documentation's table."""
    section = PAGE.read_text().split("## Listening sockets")[1].split("\n## ")[0]
    counts = {name: int(count) for name, count in ROW.findall(section)}
    return counts.get(process, counts["every other service"])


def listening(pids: Iterable[int]) -> list[tuple[str, int]]:
    """Return addresses and ports at which processes take connections or datagrams."""
    return [
        (connection.laddr.ip, connection.laddr.port)
        for pid in pids
        for connection in psutil.Process(pid).net_connections("inet")
        if connection.status in (psutil.CONN_LISTEN, psutil.CONN_NONE)
    ]


@contextmanager
def server(connect: str, *arguments: str) -> Iterator[int]:
    """Run a command that serves until the block ends; return its process number."""
    command = [sys.executable, "-m", "deploy.cli", *arguments, "--robot", ROBOT]
    process = subprocess.Popen(
        [*command, "--connect", connect],
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout
        assert process.stdout.readline()  # where it serves
        yield process.pid
    finally:
        process.kill()
        process.communicate()


def test_listening_sockets_are_those_of_the_documentation_on_loopback(state_folder: Path) -> None:
    with running(state_folder, "--loop", *EVERYTHING, "--set", "dashboard.port=0") as system:
        pids = system.pids()
        supervisor = psutil.Process(pids["router-1"]).ppid()
        found = {name.rpartition("-")[0]: listening([pid]) for name, pid in pids.items()}
        found["supervisord"] = listening([supervisor])
        for name, arguments in SERVERS.items():
            with server(system.connect, *arguments) as pid:
                found[name] = listening([pid])
    counts = Counter({name: len(sockets) for name, sockets in found.items()})
    assert counts == {name: documented(name) for name in found}
    assert {"router", "camera", "detector", "dashboard", "ros2_bridge"} < found.keys()
    beyond = {
        name: [address for address, _ in sockets if not ipaddress.ip_address(address).is_loopback]
        for name, sockets in found.items()
    }
    assert not any(beyond.values()), beyond
