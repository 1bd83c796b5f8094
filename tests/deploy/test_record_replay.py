"""Record and replay: no file is overwritten and no streams are mixed unless forced."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from deploy.cli import app
from tests import DEMO
from tests.network import Network

pytestmark = pytest.mark.network


def test_record_refuses_to_overwrite_a_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.mcap"
    file.write_bytes(b"precious")
    result = CliRunner().invoke(app, ["record", str(file)])
    assert result.exit_code == 1
    assert "exists" in result.stderr
    assert file.read_bytes() == b"precious"


def test_replay_refuses_topics_that_a_live_service_publishes(network: Network) -> None:
    robot = network.robot()
    network.open(robot).announce("gt_bridge", "gt_bridge-1")
    command = ["replay", str(DEMO), "--robot", robot, "--connect", network.endpoint, "--hold", "0"]
    result = CliRunner().invoke(app, [*command, "--speed", "50", "--topics", "truth"])
    assert result.exit_code == 1
    assert f"gt_bridge of robot {robot} publishes truth: the streams would mix" in result.stderr
    other = CliRunner().invoke(app, [*command, "--topics", "camera_info"])
    assert other.exit_code == 0, other.stderr  # another producer's topic
    forced = CliRunner().invoke(app, [*command, "--speed", "50", "--topics", "truth", "--force"])
    assert "Published 901 messages." in forced.stdout
