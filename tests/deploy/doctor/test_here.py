"""Diagnostics of a host where nothing runs, and of routers that reject a client."""

import socket
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from common.diagnosis.evidence import Diagnostic
from common.transport.ports import free_port
from deploy.cli import app
from deploy.doctor import here
from tests.security.guarded import guarded

pytestmark = pytest.mark.network


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deploy.cli.system.doctor.CONNECT_S", 1.0)


def doctor(folder: Path, *arguments: str, **environment: str) -> tuple[int, list[Diagnostic]]:
    """Run people4d doctor --json; return its exit code and diagnostics."""
    command = ["doctor", "--json", "--seconds", "0.5", *arguments]
    result = CliRunner().invoke(app, command, env={"PEOPLE4D_STATE": str(folder), **environment})
    assert result.stdout, result.stderr
    return result.exit_code, msgspec.json.decode(result.stdout, type=list[Diagnostic])


def found(diagnostics: list[Diagnostic], check: str) -> Diagnostic:
    (diagnostic,) = [f for f in diagnostics if f.check == check and f.level != "ok"]
    return diagnostic


def test_nothing_runs(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    status, diagnostics = doctor(tmp_path, "--connect", endpoint)
    assert status == 1
    router = found(diagnostics, "router")
    assert router.what == f"no router listens at {endpoint}"
    assert "people4d up" in router.hint


def test_client_without_keys_is_rejected_by_a_guarded_router(tmp_path: Path) -> None:
    with guarded(tmp_path, passwords=True) as network:
        status, diagnostics = doctor(tmp_path, "--connect", f"tcp/127.0.0.1:{network.port}")
    assert status == 1
    router = found(diagnostics, "router")
    assert "refuses this machine" in router.what
    assert "PEOPLE4D_KEYS" in router.hint


def test_keys_of_another_authority_are_reported(tmp_path: Path) -> None:
    status, diagnostics = doctor(
        tmp_path, "--connect", "tcp/127.0.0.1:1", PEOPLE4D_KEYS=str(tmp_path)
    )
    assert status == 1
    assert "holds neither operator.pem" in found(diagnostics, "settings").what


def test_invalid_endpoint_is_reported(tmp_path: Path) -> None:
    _, diagnostics = doctor(tmp_path, "--connect", "tcp/192.168.1.7")
    assert found(diagnostics, "router").what == "'tcp/192.168.1.7' is not an endpoint"


def test_listener_that_is_no_router_is_reported(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        endpoint = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        _, diagnostics = doctor(tmp_path, "--connect", endpoint)
    assert found(diagnostics, "router").what.startswith(f"{endpoint} refuses this machine")


def settings(folder: Path, text: str, **environment: str) -> list[Diagnostic]:
    file = folder / "own.toml"
    file.write_text(text)
    return list(here.settings(file, environment))


def test_shipped_settings_and_models_pass() -> None:
    diagnostics = list(here.settings(None, {}))
    assert {f.level for f in diagnostics} == {"ok"}
    assert {f.check for f in diagnostics} == {"settings", "model"}


def test_mistake_in_settings_is_reported(tmp_path: Path) -> None:
    diagnostics = settings(tmp_path, "[tracker]\ntrackr = 'sort3d'")
    assert "has no field 'trackr'" in found(diagnostics, "settings").what
    assert found(diagnostics, "settings").hint == "Did you mean tracker?"
    wrong = settings(tmp_path, "", PEOPLE4D_TRACKER_MAX_LOST_S="-1")
    assert "max_lost_s" in found(wrong, "settings").what


@pytest.mark.parametrize(
    ("content", "says"),
    [(None, "does not exist"), (b"", "cannot be loaded"), (b"no network", "cannot be loaded")],
)
def test_missing_or_corrupt_model_is_reported(
    tmp_path: Path, content: bytes | None, says: str
) -> None:
    model = tmp_path / "own.onnx"
    if content is not None:
        model.write_bytes(content)
    diagnostic = found(settings(tmp_path, f'[detector]\nmodel = "{model}"'), "model")
    assert diagnostic.what.startswith("detector: model file")
    assert says in diagnostic.what
    assert diagnostic.hint


def test_last_error_of_the_log_explains_a_process_that_is_down(tmp_path: Path) -> None:
    log = tmp_path / "detector-1.log"
    log.write_text(
        "2026 detector-1 ERROR model file x does not exist. See: people4d models.\nbye\n"
    )
    assert here._last_word(log) == "model file x does not exist. See: people4d models."
    log.write_text("2026 camera-1 INFO finished: the recording is cut short\n")
    assert here._last_word(log) == "finished: the recording is cut short"
    assert here._last_word(tmp_path / "none") == "its log is empty"
