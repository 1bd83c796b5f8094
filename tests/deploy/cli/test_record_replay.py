"""Record and replay: no file is overwritten and no streams are mixed unless forced."""

import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner

from common.io.recording import open_recording
from deploy.cli import app
from people4d.messages import CameraInfo, StaticTransform
from tests import DEMO, builders
from tests.network import Network

pytestmark = pytest.mark.network


def test_record_refuses_to_overwrite_a_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.mcap"
    file.write_bytes(b"precious")
    result = CliRunner().invoke(app, ["record", str(file)])
    assert result.exit_code == 1
    assert "exists" in result.stderr
    assert file.read_bytes() == b"precious"


def test_record_without_a_system_leaves_no_file(tmp_path: Path) -> None:
    file = tmp_path / "a.mcap"
    result = CliRunner().invoke(app, ["record", str(file), "--connect", "tcp/127.0.0.1:1"])
    assert result.exit_code == 1
    assert not file.exists()


def test_record_creates_no_folder(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["record", str(tmp_path / "b" / "a.mcap")])
    assert result.exit_code == 1
    assert f"folder {tmp_path / 'b'} does not exist" in result.stderr
    assert not (tmp_path / "b").exists()


def test_replay_refuses_topics_that_a_live_service_publishes(network: Network) -> None:
    robot = network.robot()
    network.open(robot).announce("gt_bridge", "gt_bridge-1")
    command = ["replay", str(DEMO), "--robot", robot, "--connect", network.endpoint, "--hold", "0"]
    result = CliRunner().invoke(app, [*command, "--rate", "50", "--topics", "truth"])
    assert result.exit_code == 1
    assert f"gt_bridge of robot {robot} publishes truth: the streams would mix" in result.stderr
    other = CliRunner().invoke(app, [*command, "--topics", "camera_info"])
    assert other.exit_code == 0, other.stderr  # another producer's topic
    forced = CliRunner().invoke(app, [*command, "--rate", "50", "--topics", "truth", "--force"])
    assert "Published 901 messages." in forced.stdout


def test_replay_starts_and_ends_where_asked(network: Network) -> None:
    command = ["replay", str(DEMO), "--connect", network.endpoint, "--hold", "0", "--rate", "50"]
    command += ["--robot", network.robot(), "--topics", "truth,camera_info,static_transforms"]
    some = CliRunner().invoke(app, [*command, "--start", "2", "--end", "3"])
    assert "Published 103 messages." in some.stdout, some.stderr  # 100 Hz, and two from before
    after = CliRunner().invoke(app, [*command, "--start", "60"])
    assert "--start 60 lies after the end of the recording" in after.stderr
    crossed = CliRunner().invoke(app, [*command, "--start", "3", "--end", "2"])
    assert "--end 2 lies before --start 3" in crossed.stderr


def test_cut_writes_a_part_that_plays_alone(tmp_path: Path) -> None:
    target = tmp_path / "part.mcap"
    result = CliRunner().invoke(app, ["cut", str(DEMO), str(target), "--start", "2", "--end", "3"])
    assert "Wrote 119 messages" in result.stdout, result.stderr
    before, after = open_recording(DEMO), open_recording(target)
    assert after.metadata == before.metadata
    assert after.summary.start_ns == before.summary.start_ns + 2 * 10**9
    assert after.summary.duration_s == 1.0
    kinds = [type(message) for _, message in after.messages()]
    assert {CameraInfo, StaticTransform} == set(kinds[:2])
    again = CliRunner().invoke(app, ["cut", str(DEMO), str(target)])
    assert "exists" in again.stderr
    itself = CliRunner().invoke(app, ["cut", str(target), str(target), "--force"])
    assert "is the recording itself" in itself.stderr


def test_record_around_an_event(network: Network, tmp_path: Path) -> None:
    robot = network.robot()
    bus = network.open(robot)
    stopped = threading.Event()

    def publish() -> None:
        for k in range(10**9):
            bus.publish(builders.odometry(stamp_ns=k, sequence=k))
            if k > 20:
                bus.publish(builders.tracks(builders.track(), stamp_ns=k, sequence=k))
            if stopped.wait(0.01):
                return

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        file = tmp_path / "x.mcap"
        command = ["record", str(file), "--last", "0.3", "--seconds", "2", "--topics", "odometry"]
        command += ["--robot", robot, "--connect", network.endpoint]
        result = CliRunner().invoke(app, command)
    finally:
        stopped.set()
        thread.join()
    assert "1 file of events." in result.stdout, result.stderr
    assert {"odometry", "people"} == open_recording(tmp_path / "x-0001.mcap").summary.topics.keys()
