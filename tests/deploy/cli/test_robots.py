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

pytestmark = pytest.mark.network

COMMANDS = (  # that end by themselves
    ["listen", "--once", "--timeout", "0.5"],
    ["score", "--once", "--timeout", "0.5"],
    ["record", "--seconds", "0.5", "FILE"],
    ["trace", "--seconds", "0.5"],
    ["health", "tracker", "--timeout", "0.5"],
    ["top", "--once", "--window", "1"],
    ["ps"],
)
PROGRAM = "from deploy.cli import app, options; options.SILENCE_S = 0.1; app()"
WARNING = "no robot 'robot' is there, but 'newcomer'; add --robot 'newcomer'"


@pytest.fixture(scope="module")
def network() -> Iterator[Network]:
    """A router of its own: other tests announce robots."""
    own = Network()
    yield own
    own.close()


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
def test_wrong_robot_is_reported_with_the_one_that_is_there(
    command: list[str],
    network: Network,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr("deploy.cli.options.SILENCE_S", 0.1)
    network.open("newcomer").announce("tracker", "tracker-1")
    arguments = [str(tmp_path / "out.mcap") if part == "FILE" else part for part in command]
    endpoint = network.endpoint.removeprefix("tcp/")
    full = [*arguments, "--robot", "robot", "--connect", endpoint]
    result = CliRunner().invoke(app, full)
    assert WARNING in caplog.text + result.stderr


@pytest.mark.processes
def test_view_that_waits_reports_the_robot_that_is_there(network: Network) -> None:
    network.open("newcomer").announce("tracker", "tracker-1")
    command = ["view", "--foxglove", "--port", "0", "--robot", "robot"]
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *command, "--connect", network.endpoint],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr
    try:
        lines = iter(process.stderr.readline, "")
        line = next(line for line in lines if "newcomer" in line)
    finally:
        process.kill()
        process.communicate()
    assert WARNING in line


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Path]:
    """Folder of states; one, newcomer, belongs to a running process."""
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
    assert f"{expected} serves no dashboard" in result.stderr


def test_robot_of_a_router_elsewhere_is_not_the_one_that_runs_here(
    running: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deploy.cli.system.doctor.CONNECT_S", 0.3)
    environment = {"PEOPLE4D_STATE": str(running)}
    command = ["doctor", "--connect", "tcp/127.0.0.1:2", "--json"]
    result = CliRunner().invoke(app, command, env=environment)
    assert "no router listens at tcp/127.0.0.1:2" in result.stdout
    assert "newcomer" not in result.stdout
