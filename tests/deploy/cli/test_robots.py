"""The robot that a command is about: named, the only one that runs here, or reported as absent."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from deploy.cli import app
from deploy.launcher.state import MARK, Run
from tests.network import Network

pytestmark = [pytest.mark.processes, pytest.mark.network]

COMMANDS = (
    ["listen", "--once", "--timeout", "3"],
    ["score", "--once", "--timeout", "3"],
    ["record", "--seconds", "3", "FILE"],
    ["trace", "--seconds", "3"],
    ["health", "tracker"],
    ["view", "--foxglove", "--port", "0"],
    ["top", "--once"],
    ["ps"],
)


@pytest.fixture
def network() -> Iterator[Network]:
    """A router of its own: other tests announce robots."""
    own = Network()
    yield own
    own.close()


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
def test_wrong_robot_is_reported_with_the_one_that_is_there(
    command: list[str], network: Network, tmp_path: Path
) -> None:
    network.open("newcomer").announce("tracker", "tracker-1")
    arguments = [str(tmp_path / "out.mcap") if part == "FILE" else part for part in command]
    endpoint = network.endpoint.removeprefix("tcp/")
    full = [*arguments, "--robot", "robot", "--connect", endpoint]
    process = subprocess.Popen(
        [sys.executable, "-m", "deploy.cli", *full], stderr=subprocess.PIPE, text=True
    )
    assert process.stderr
    try:
        lines = iter(process.stderr.readline, "")
        line = next(line for line in lines if "newcomer" in line)
    finally:
        process.kill()
        process.communicate()
    assert "no robot 'robot' is there, but 'newcomer'; add --robot 'newcomer'" in line


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Path]:
    """Folder of states, of which one, newcomer, belongs to a process that runs."""
    folder = tmp_path / "newcomer"
    folder.mkdir()
    (tmp_path / "gone").mkdir()
    process = subprocess.Popen(
        [sys.executable, "-c", "print('up', flush=True); input()"],
        env={MARK: str(folder)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdout
    process.stdout.readline()
    run = Run(connect="tcp/127.0.0.1:1", pid=process.pid)
    (folder / "run.json").write_bytes(msgspec.json.encode(run))
    yield tmp_path
    process.communicate()


@pytest.mark.parametrize(("named", "expected"), [((), "newcomer"), (("--robot", "other"), "other")])
def test_the_only_robot_that_runs_here_is_taken(
    named: tuple[str, ...], expected: str, running: Path
) -> None:
    environment = {"PEOPLE4D_STATE": str(running)}
    result = CliRunner().invoke(app, ["open", *named], env=environment)
    assert f"no page of {expected} is there" in result.stderr


def test_robot_of_a_router_elsewhere_is_not_the_one_that_runs_here(running: Path) -> None:
    environment = {"PEOPLE4D_STATE": str(running)}
    command = ["doctor", "--connect", "tcp/127.0.0.1:2", "--json"]
    result = CliRunner().invoke(app, command, env=environment)
    assert "no router listens at tcp/127.0.0.1:2" in result.stdout
    assert "newcomer" not in result.stdout
