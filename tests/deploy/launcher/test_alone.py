"""Each service alone against recorded messages: the commands of docs/launch/one_service.md."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from common.io.recording import RecordingWriter, open_recording
from deploy.cli import app
from deploy.cli.system.demo import DEMO
from people4d.messages import CompressedRgbdFrame, Crops, Detections, Message, Tracks, Truth

pytestmark = [pytest.mark.processes, pytest.mark.timeout(900)]

PEOPLE4D = (sys.executable, "-m", "deploy.cli")
TIMEOUT_S = 120.0
FRAMES = 15
# Frames are live: on a busy machine a reader misses some frames at full speed.
SLOWLY = ("--rate", "0.4", "--hold", "1")


@pytest.fixture(scope="module")
def environment() -> Iterator[Mapping[str, str]]:
    """A separate router on a free port, and the environment for its clients."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    variables = {**os.environ, "PEOPLE4D_CONNECT": endpoint, "OMP_NUM_THREADS": "1"}
    with service("router", {**variables, "PEOPLE4D_LISTEN": endpoint}):
        yield variables


@contextmanager
def service(name: str, environment: Mapping[str, str], *arguments: str) -> Iterator[None]:
    """Run one service, healthy inside the block."""
    command = [*PEOPLE4D, "run", name, *arguments]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
        try:
            people4d(environment, "health", name, "--timeout", str(TIMEOUT_S))
            yield
        finally:
            process.send_signal(signal.SIGTERM)
            with ending(process):
                _, errors = process.communicate(timeout=TIMEOUT_S)
            assert process.returncode == 0, errors


@contextmanager
def ending(process: subprocess.Popen[Any]) -> Iterator[None]:
    """Kill a process that has not ended: leaving its own context waits for it."""
    try:
        yield
    finally:
        process.kill()


def people4d(environment: Mapping[str, str], *arguments: str) -> str:
    """Run a command in this process, without the start of another one."""
    result = CliRunner().invoke(app, arguments, env=environment)
    assert result.exit_code == 0, result.stderr
    return result.stdout


@contextmanager
def recording(file: Path, topics: str, environment: Mapping[str, str]) -> Iterator[None]:
    """Record what is published inside the block."""
    command = [*PEOPLE4D, "record", str(file), "--topics", topics]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr
        assert "Recording" in process.stderr.readline()
        try:
            yield
        finally:
            process.send_signal(signal.SIGTERM)
            with ending(process):
                process.communicate(timeout=TIMEOUT_S)


def count(file: Path, kind: type[Message]) -> int:
    return sum(1 for _ in open_recording(file).messages(kind))


def people(file: Path, kind: type[Message]) -> list[Message]:
    return [message for _, message in open_recording(file).messages(kind)]


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first second of the demo."""
    file = tmp_path_factory.mktemp("demo") / "demo.mcap"
    frames = 0
    shipped = open_recording(DEMO)
    with RecordingWriter(file) as writer:
        for name, values in shipped.metadata.items():
            writer.write_metadata(name, values)
        for log_ns, message in shipped.messages():
            writer.write(message, log_ns)
            frames += type(message).__name__ == "CompressedRgbdFrame"
            if frames == FRAMES:
                break
    return file


def test_detector_and_tracker_run_alone(
    demo: Path, tmp_path: Path, environment: Mapping[str, str]
) -> None:
    # A service ends before the recording, and handles the received messages.
    detected, tracked = (tmp_path / f"{name}.mcap" for name in ("seen", "tracked"))

    with ExitStack() as stack:
        stack.enter_context(recording(detected, "detections,crops,static_transforms", environment))
        stack.enter_context(service("detector", environment))
        topics = "frames,camera_info,static_transforms"
        people4d(environment, "replay", str(demo), "--topics", topics, *SLOWLY)
    detections = [m for m in people(detected, Detections) if isinstance(m, Detections)]
    assert len(detections) >= FRAMES // 3
    assert count(detected, Crops) == len(detections)
    assert all(person.position_m is not None for m in detections for person in m.detections)
    assert max(len(m.detections) for m in detections) == 3

    with ExitStack() as stack:
        stack.enter_context(recording(tracked, "people,truth", environment))
        stack.enter_context(service("tracker", environment))
        stack.enter_context(service("gt_bridge", environment, "--set", f'truth="{demo}"'))
        topics = "detections,static_transforms"
        people4d(environment, "replay", str(detected), "--topics", topics, "--hold", "0")
    tracks = [m for m in people(tracked, Tracks) if isinstance(m, Tracks)]
    assert len({m.stamp_ns for m in tracks} & {m.stamp_ns for m in detections}) == len(detections)
    assert max(len(m.tracks) for m in tracks) == 3
    assert count(tracked, Truth) > 0


def test_camera_runs_alone(demo: Path, tmp_path: Path, environment: Mapping[str, str]) -> None:
    played = tmp_path / "played.mcap"
    with ExitStack() as stack:
        stack.enter_context(recording(played, "frames", environment))
        # At a low rate: on a busy machine the recorder misses frames, like any reader.
        settings = ("--set", f'source="{demo}"', "--set", "speed=0.2")
        camera = [*PEOPLE4D, "run", "camera", *settings]
        subprocess.run(camera, env=environment, timeout=TIMEOUT_S, check=True)
    assert count(played, CompressedRgbdFrame) == FRAMES  # compressed by the recorder


def test_report_runs_alone(demo: Path, tmp_path: Path, environment: Mapping[str, str]) -> None:
    with service("report", environment, "--set", f'folder="{tmp_path}"', "--set", "video=false"):
        topics = "frames,camera_info,static_transforms,truth"
        people4d(environment, "replay", str(demo), "--topics", topics, "--hold", "0.3")
    assert (tmp_path / "summary.txt").stat().st_size > 0
    assert (tmp_path / "contact_sheet.png").stat().st_size > 0


def test_replay_reports_absent_topics(demo: Path) -> None:
    result = CliRunner().invoke(app, ["replay", str(demo), "--topics", "crops"])
    assert result.exit_code == 1
    assert "holds no message of crops. It holds camera/front/info" in result.stderr
