"""Extras: declared in the distribution, checked before any work, with one error message."""

import sys
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from common import extras
from deploy.cli import app
from people4d.errors import ConfigError
from services.events import mqtt
from services.events.config import EventsConfig
from tests import DEMO, ROOT

INSTALL = "-m pip install 'people4d-robot[{}]'"


def test_every_extra_is_one_of_the_distribution() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["name"] == "people4d-robot"
    assert set(extras.MODULES) <= set(project["optional-dependencies"])


@pytest.mark.parametrize("extra", extras.MODULES)
def test_missing_extra_is_an_error_with_its_installation(
    extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, extras.MODULES[extra][0], None)
    with pytest.raises(ConfigError) as caught:
        extras.need("this", extra)
    assert caught.value.problem == f"this needs {extras.MODULES[extra][0]}, which is not installed"
    assert INSTALL.format(extra) in caught.value.hint
    assert sys.executable in caught.value.hint


@pytest.mark.parametrize(
    ("extra", "command"),
    [
        ("rerun", ["view", "--rerun"]),
        ("foxglove", ["view", "--foxglove"]),
        ("prometheus", ["export", "--prometheus", "0"]),
        ("otel", ["export", "--otlp", "http://127.0.0.1:1"]),
        ("quantize", ["models", "quantize", "movenet-multipose"]),
        ("parquet", ["csv", str(DEMO), "FILE.parquet"]),
        ("keys", ["keys", "FILE"]),
        ("dashboard", ["up", "demo", "--dashboard"]),
        ("mqtt", ["export", "--mqtt", "mqtt://127.0.0.1:1"]),
        ("mqtt", ["up", "demo", "--events", "--set", "events.mqtt='mqtt://127.0.0.1:1'"]),
    ],
)
def test_command_misses_its_extra_before_any_work(
    extra: str, command: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # A missing extra must be reported before frames are rendered, and before a missing router.
    monkeypatch.setitem(sys.modules, extras.MODULES[extra][0], None)
    monkeypatch.setenv("PEOPLE4D_STATE", str(tmp_path))
    monkeypatch.setenv("PEOPLE4D_CONNECT", "tcp/127.0.0.1:1")
    arguments = [part.replace("FILE", str(tmp_path / "file")) for part in command]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert INSTALL.format(extra) in result.stderr
    assert not [file for file in tmp_path.rglob("*") if file.is_file()]


def test_events_without_a_broker_need_no_client(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "paho", None)
    mqtt.check_broker(EventsConfig())
