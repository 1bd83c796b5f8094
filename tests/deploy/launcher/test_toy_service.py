"""A new service is one folder and one block of compose.yaml."""

import importlib
from pathlib import Path

import pytest

import services
from common.transport.memory_bus import MemoryBus
from deploy.launcher.plan import COMPOSE_FILE, CONFIG_FILE, LaunchRequest, plan, read_settings
from tests import builders

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
}


def test_service_is_a_folder_and_a_block_of_compose_yaml(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, compose = tmp_path / "services" / "toy", tmp_path / "compose.yaml"
    folder.mkdir(parents=True)
    for name, text in FILES.items():
        (folder / name).write_text(text)
    compose.write_text(COMPOSE_FILE.read_text(encoding="utf-8") + BLOCK, encoding="utf-8")
    monkeypatch.setattr(services, "__path__", [*services.__path__, str(folder.parent)])

    planned = plan(LaunchRequest(compose=compose, settings=["toy.step=2"], environment={}))
    (toy,) = (service for service in planned if service.name == "toy")
    assert toy.command == ("python", "-m", "services.toy", "--set", "step=2")
    assert toy.has_healthcheck
    settings = read_settings(toy, CONFIG_FILE, {}, toy.command[-1:])
    node = importlib.import_module("services.toy.build").build(settings)
    MemoryBus([node]).publish(builders.tracks(builders.track()))
    assert node.status().counters == {"tracks": 2}
