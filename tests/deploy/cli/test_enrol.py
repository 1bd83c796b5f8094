"""people4d enrol and forget: the command is sent, and its answer shown."""

import threading

import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

from deploy.cli import app
from people4d.messages import TargetCommand
from tests.deploy.cli.test_follow import TARGET
from tests.network import Network, Watcher


@pytest.mark.network
@pytest.mark.parametrize(
    ("action", "problem", "shown"),
    [("enrol", "", "enrolled anna"), ("forget", "anna is not enrolled", "anna is not enrolled")],
)
def test_command_is_sent_and_its_answer_shown(
    network: Network, action: str, problem: str, shown: str
) -> None:
    robot = network.robot()
    bus = network.open(robot)
    bus.announce("target", "target-1")
    watcher = Watcher(bus, TargetCommand)

    def answer() -> None:
        command = watcher.wait(TargetCommand, lambda one: one.action == action)
        assert command.name == "anna"
        bus.publish(replace(TARGET, answered_ns=command.stamp_ns, problem=problem))

    answering = threading.Thread(target=answer)
    answering.start()
    options = ["--timeout", "30", "--robot", robot, "--connect", network.endpoint]
    result = CliRunner().invoke(app, [action, "anna", *options])
    answering.join()
    assert (result.exit_code == 0) == (problem == ""), result.output
    assert shown in result.output


@pytest.mark.parametrize("time_s", ["nan", "inf", "0", "-1"])
def test_bad_timeout_is_refused_before_any_connection(time_s: str) -> None:
    for command in (["forget", "anna"], ["follow", "--nearest"], ["up"]):
        result = CliRunner().invoke(app, [*command, "--timeout", time_s])
        assert result.exit_code == 2
        assert "positive number of seconds" in result.output


def test_bad_name_is_refused_before_any_connection() -> None:
    for command in (["enrol", "../a"], ["forget", ""], ["follow", "--name", "a b"]):
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 2
        assert "1 to 64 characters" in result.output
