"""people4d score: table of hand-worked scores, and live for a late joiner."""

import threading

import msgspec
import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from deploy.cli import app
from deploy.cli.live.views import render_score
from people4d.messages import Alignment, PersonScore, Score
from tests.contract.examples import BY_NAME
from tests.network import WAIT_S, Network

pytestmark = pytest.mark.network


def example() -> Score:
    message = BY_NAME["Score"]
    assert isinstance(message, Score)
    return message


FULL = example()


def drawn(message: Score) -> list[list[str]]:
    console = Console(width=140)
    with console.capture() as capture:
        console.print(render_score(message))
    return [line.split() for line in capture.get().splitlines() if line.split()]


def test_table_has_people_and_totals() -> None:
    lines = drawn(FULL)
    # off sqrt(0.1^2 + 0.2^2) = 0.22 m, 0.50 m/s, -0.5 rad = -29 degrees
    assert ["anna", "7", "0.22", "0.50", "-29", "75", "%"] in lines
    assert ["none", "9"] in lines
    # 0.125 rad = 7.2 degrees; 3 of 4 found; 1 of 3 predicted; 1 switch in 0.5 s = 120 a minute
    assert lines[5:-1] == [
        ["position", "rmse", "0.250", "m", "0.250", "m"],
        ["velocity", "rmse", "0.500", "m/s", "0.500", "m/s"],
        ["yaw", "rmse", "7.2", "°", "7.2", "°"],
        ["matched", "75.0", "%", "75.0", "%"],
        ["predicted", "of", "these", "33.3", "%", "33.3", "%"],
        ["false", "alarms", "1", "1"],
        ["people", "out", "of", "view", "2", "2"],
        ["id", "switches", "1", "1"],
        ["a", "minute", "120.0", "120.0"],
        ["frames", "2", "2"],
    ]
    alignment = " ".join(lines[-1])
    assert alignment.startswith("alignment applied · clock +80 ± 1 ms · shift +0.00 +0.00 +0.00 m")


def test_unknown_view_is_reported() -> None:
    people = (PersonScore(id="a", view="unknown"), PersonScore(id="b", view="outside"))
    lines = drawn(msgspec.structs.replace(FULL, people=people, alignment=None))
    assert ["a", "unknown", "none", "-", "-", "-", "-"] in lines
    assert ["b", "outside", "-", "-", "-", "-"] in lines
    assert "all people count, also out of view" in " ".join(lines[-1])


def test_failed_alignment_is_reported_with_its_reason() -> None:
    lines = drawn(msgspec.structs.replace(FULL, alignment=Alignment(applied=False)))
    assert "people must walk in different directions" in " ".join(lines[-1])
    turned = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]])
    found = Alignment(applied=False, matrix=turned, rmse_before_m=1.0, rmse_after_m=0.5)
    lines = drawn(msgspec.structs.replace(FULL, alignment=found))
    assert "shift +1.00 +2.00 +0.00 m, turn +90.0°" in " ".join(lines[-1])


def test_late_joiner_gets_the_totals(network: Network) -> None:
    robot, done = network.robot(), threading.Event()
    bus = network.open(robot)

    def publish() -> None:  # one message for each frame, as from the bridge
        while not done.wait(0.05):
            bus.publish(FULL)

    thread = threading.Thread(target=publish)
    thread.start()
    arguments = ["score", "--once", "--timeout", str(WAIT_S), "--robot", robot]
    try:
        shown, plain = (
            CliRunner().invoke(app, [*arguments, *more, "--connect", network.endpoint])
            for more in ([], ["--json"])
        )
    finally:
        done.set()
        thread.join()
    assert shown.exit_code == plain.exit_code == 0
    assert "in all" in shown.stdout
    assert msgspec.json.decode(plain.stdout)["total"]["matched"] == 3


@pytest.mark.parametrize("more", [[], ["--once"], ["--json"]])
def test_absent_score_is_reported_with_a_hint(network: Network, more: list[str]) -> None:
    arguments = ["score", "--timeout", "0.3", "--connect", network.endpoint, *more]
    result = CliRunner().invoke(app, [*arguments, "--robot", network.robot()])
    assert result.exit_code == 1
    assert "no score arrived within 0.3 s. It needs people and truth" in result.stderr


def test_each_message_is_printed_where_there_is_no_terminal(network: Network) -> None:
    robot = network.robot()
    bus, done = network.open(robot), threading.Event()

    def publish() -> None:
        for _ in range(20):
            bus.publish(FULL)
            done.wait(0.05)

    thread = threading.Thread(target=publish)
    thread.start()
    arguments = ["score", "--timeout", "1.5", "--robot", robot, "--connect", network.endpoint]
    result = CliRunner().invoke(app, arguments)
    thread.join()
    assert result.stdout.count("people in the truth") > 1
