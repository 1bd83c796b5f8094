"""A new service is one folder and one block of compose.yaml: shown on a copy of the project."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from common.transport.ports import free_port
from people4d.client import Client
from people4d.messages import Health
from tests import DEMO, ROOT

pytestmark = [pytest.mark.processes, pytest.mark.network]

PACKAGES = ("people4d", "common", "services", "lab", "evaluation", "deploy", "models")
BLOCK = """
  toy: # counts people
    <<: *service
    command: ["python", "-m", "services.toy"]
    environment: *environment
    depends_on: *after-router
    healthcheck:
      <<: *healthcheck
      test: ["CMD", "people4d", "health", "toy", "--here"]
"""
FILES = {
    "__init__.py": '"""A toy."""\n',
    "config.py": '''"""Configuration of the toy."""

from common.config import Config


class ToyConfig(Config, frozen=True, kw_only=True):
    """Configuration of the toy."""

    step: int = 1  # added for each track
''',
    "node.py": '''"""The toy: counts tracks."""

from collections.abc import Sequence
from typing import ClassVar

from common.runtime.node import Node, Status
from people4d.messages import Message, Tracks
from services.toy.config import ToyConfig


class ToyNode(Node):
    """Counts tracks."""

    inputs: tuple[type[Message], ...] = (Tracks,)

    def __init__(self, config: ToyConfig) -> None:
        self._config, self._count = config, 0

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Count the tracks of a message."""
        assert isinstance(message, Tracks)
        self._count += self._config.step * len(message.tracks)
        return ()

    def status(self) -> Status:
        """Return the count."""
        return Status(counters={"tracks": self._count})
''',
    "build.py": '''"""Build the node of the toy."""

from services.toy.config import ToyConfig
from services.toy.node import ToyNode


def build(config: ToyConfig) -> ToyNode:
    """Build the node."""
    return ToyNode(config)
''',
    "__main__.py": '''"""The toy as a process."""

import sys

from common.runtime import process
from services.toy.build import build
from services.toy.config import ToyConfig

if __name__ == "__main__":
    sys.exit(process.main("toy", ToyConfig, build))
''',
}
COMMAND = (sys.executable, "-c", "from people4d_command import main; main()")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A copy of the project with a further service."""
    for name in PACKAGES:
        ignore = shutil.ignore_patterns("__pycache__", "*.mcap")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignore)
    shutil.copy(ROOT / "people4d_command.py", tmp_path)
    (tmp_path / "services" / "toy").mkdir()
    for name, text in FILES.items():
        (tmp_path / "services" / "toy" / name).write_text(text)
    with (tmp_path / "deploy" / "compose.yaml").open("a") as compose:
        compose.write(BLOCK)
    return tmp_path


def test_service_is_a_folder_and_a_block_of_compose_yaml(project: Path, state_folder: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(project), "PEOPLE4D_STATE": str(state_folder)}
    port = free_port()

    def people4d(*arguments: str) -> None:
        done = subprocess.run(
            [*COMMAND, *arguments],
            check=False,
            capture_output=True,
            text=True,
            env=environment,
            cwd=project,
        )
        assert done.returncode == 0, done.stdout + done.stderr

    options = ("--set", "toy.step=2", "--source", str(DEMO), "--loop", "--port", str(port), "-d")
    people4d("up", *options)
    try:
        with Client(f"tcp/127.0.0.1:{port}") as client:
            toys = (h for h in client.messages(Health, timeout_s=30) if h.service == "toy")
            counted = next(health for health in toys if health.counters["tracks"] > 0)
        assert counted.instance == "toy-1"
        assert counted.counters["tracks"] % 2 == 0
    finally:
        people4d("down")
