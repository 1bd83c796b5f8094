"""people4d follow: choices of the options, and the line of a state."""

import threading

import numpy as np
import pytest
import typer
from msgspec.structs import replace
from typer.testing import CliRunner

from deploy.cli import app
from deploy.cli.live.follow import command_of, line_of
from people4d.messages import Target, TargetCommand
from tests.network import Network, Watcher

TARGET = Target(
    stamp_ns=1_500_000_000,
    sequence=0,
    state="locked",
    frame_id="map",
    camera="front",
    id=7,
    position_m=np.array([3.0, 0.0, 1.0]),
    velocity_mps=np.zeros(3),
    probability=0.99,
    reason="continued",
    distance_m=3.0,
    bearing_rad=np.pi / 2,
    stop=False,
    chooser="people4d follow",
)


def test_options_give_one_choice() -> None:
    by_id, at = command_of({"id": 3, "nearest": False}), command_of({"at": (1.0, 2.0)})
    assert by_id
    assert at
    assert at.position_m is not None
    assert (by_id.action, by_id.id) == ("id", 3)
    assert (at.action, at.position_m.tolist()) == ("at", [1.0, 2.0])
    raised = command_of({"id": None, "raised_hand": True})
    assert raised
    assert raised.action == "raised_hand"
    assert command_of({"id": None, "nearest": False, "at": None}) is None


def test_two_choices_are_refused() -> None:
    with pytest.raises(typer.BadParameter, match="give one of"):
        command_of({"id": 3, "nearest": True})


@pytest.mark.parametrize(
    "choice", [["--at", "nan", "1"], ["--at", "1e300", "0"], ["9" * 23], ["--name", ""]]
)
def test_absurd_choice_is_refused_before_any_connection(choice: list[str]) -> None:
    result = CliRunner().invoke(app, ["follow", *choice])
    assert result.exit_code == 2
    assert "Invalid value" in result.output


def test_state_is_one_line() -> None:
    assert line_of(TARGET) == (
        "1.50  locked     person 7  3.00 m at 90 deg  probability 0.99  continued"
    )


@pytest.mark.network
def test_choice_is_sent_and_the_state_shown(network: Network) -> None:
    robot = network.robot()
    bus = network.open(robot)
    bus.announce("target", "target-1")
    watcher = Watcher(bus, TargetCommand)

    def answer() -> None:
        command = watcher.wait(TargetCommand, lambda command: command.action == "nearest")
        bus.publish(replace(TARGET, reason="before"))
        bus.publish(replace(TARGET, answered_ns=command.stamp_ns))

    answering = threading.Thread(target=answer)
    answering.start()
    options = ["--once", "--timeout", "30", "--robot", robot, "--connect", network.endpoint]
    result = CliRunner().invoke(app, ["follow", "--nearest", *options])
    answering.join()
    assert result.exit_code == 0, result.output
    assert "locked" in result.output
    assert "before" not in result.output


@pytest.mark.network
@pytest.mark.parametrize(
    "command", [["follow"], ["follow", "--nearest", "--once"], ["enrol", "anna"]]
)
def test_system_without_the_target_service_is_reported_at_once(
    network: Network, command: list[str]
) -> None:
    robot = network.robot()
    network.open(robot).announce("tracker", "tracker-1")
    result = CliRunner().invoke(app, [*command, "--robot", robot, "--connect", network.endpoint])
    assert result.exit_code == 1
    assert "does not run. Start it with people4d up ... --target" in result.stderr


@pytest.mark.network
def test_state_ends_with_the_target_service(network: Network) -> None:
    robot = network.robot()
    bus = network.open(robot)
    bus.announce("target", "target-1")
    stopped = threading.Event()

    def publish_then_stop() -> None:
        while not stopped.wait(0.05):
            bus.publish(TARGET)
        bus.close()

    publishing = threading.Thread(target=publish_then_stop)
    publishing.start()
    threading.Timer(1.0, stopped.set).start()
    result = CliRunner().invoke(app, ["follow", "--robot", robot, "--connect", network.endpoint])
    publishing.join()
    assert result.exit_code == 1
    assert "locked" in result.stdout
    assert "does not run" in result.stderr
