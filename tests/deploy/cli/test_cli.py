"""The command line: help, errors in one sentence, tables."""

import os
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from common.io.recording import RecordingWriter
from deploy.cli import COMMANDS, app, options
from deploy.cli.live.views import latency_ms, table_of
from deploy.cli.options import kinds_of
from deploy.cli.system.ps import duration
from deploy.launcher.health import works
from deploy.launcher.launcher import tail
from people4d.errors import ConfigError
from people4d.messages import Health, Span, Tracks
from services.events.journal import JOURNAL, Journal
from tests import DEMO, builders


def run(*arguments: str, state: Path | None = None) -> tuple[int, str, str]:
    environment = {"PEOPLE4D_STATE": str(state)} if state else {}
    result = CliRunner().invoke(app, arguments, env=environment)
    return result.exit_code, result.stdout, result.stderr


@pytest.mark.parametrize("command", [name for name, _, _ in COMMANDS])
def test_every_command_has_help(command: str) -> None:
    status, output, _ = run(command, "--help")
    assert status == 0
    assert "Usage" in output


@pytest.mark.processes
def test_help_imports_nothing_heavy() -> None:
    """Help and completion must stay fast: numpy, zenoh and others are for commands."""
    code = "import sys, deploy.cli; print({'numpy', 'zenoh', 'cv2'} & set(sys.modules))"
    output = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert output.stdout == "set()\n"


def test_version_is_printed() -> None:
    status, output, _ = run("--version")
    assert (status, output.split()[0]) == (0, "people4d")


@pytest.mark.network
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["ps"], "nothing runs here for robot. Start it with people4d up"),
        (["logs"], "there is no log of any process"),
        (["up"], "no camera is named. Add --source PATH"),
        (["up", "--source", "/none.bag"], "source /none.bag does not exist. Check the path."),
        (["up", "--source", "a.b:C", "--set", "x"], "setting 'x' is incomplete"),
        (["run", "singer"], "unknown service 'singer'. Services are camera,"),
        (["record", "/tmp/x.mcap", "--topics", "peeple"], "unknown topic 'peeple'"),
        (["info", "/none"], "'/none' does not exist"),
        (["listen", "--connect", "tcp/127.0.0.1:1"], "no Zenoh session"),
        (["listen", "--connect", "tcp://127.0.0.1:7447"], "not an endpoint. Write it as tcp/"),
        (["listen"], "no system of robot robot runs here. people4d up starts one"),
        (["replay", str(DEMO)], "no system of robot robot runs here. people4d up starts one"),
    ],
)
def test_error_is_one_sentence_with_a_hint(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(options, "CONNECT_S", 0.2)
    status, output, errors = run(*arguments, state=tmp_path)
    assert status == 1
    assert output == ""
    assert message in errors
    assert errors.startswith("error: ")
    assert "Traceback" not in errors


def test_events_are_not_written_to_a_missing_folder(tmp_path: Path) -> None:
    (tmp_path / "robot").mkdir()
    Journal(tmp_path / "robot" / JOURNAL, 1).close()
    status, _, errors = run("events", "--csv", str(tmp_path / "b" / "x.csv"), state=tmp_path)
    assert (status, f"folder {tmp_path / 'b'} does not exist" in errors) == (1, True), errors


def test_info_of_what_cannot_be_played_exits_with_1(tmp_path: Path) -> None:
    file = tmp_path / "tracks.mcap"
    with RecordingWriter(file) as writer:
        writer.write(builders.tracks(), 0)
    for more in ([], ["--json"]):
        status, output, _ = run("info", str(file), *more)
        assert (status, "Record camera_info too." in " ".join(output.split())) == (1, True)
    assert run("info", str(DEMO))[0] == 0


def test_debug_shows_the_trace() -> None:
    result = CliRunner().invoke(app, ["--debug", "up"])
    assert isinstance(result.exception, ConfigError)


@pytest.mark.parametrize(
    "arguments", [["nonsense"], ["--nonsense"], ["up", "--nonsense"], ["health"]]
)
def test_wrong_usage_exits_with_2(arguments: list[str]) -> None:
    status, _, errors = run(*arguments)
    assert status == 2
    assert errors.startswith("Usage: root")
    assert "╭" not in errors


def test_down_without_a_running_system_succeeds(tmp_path: Path) -> None:
    assert run("down", state=tmp_path) == (0, "Nothing runs for robot.\n", "")


def test_logs_shows_one_service_or_all(tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    folder.mkdir()
    (folder / "camera-1.log").write_text("one\ntwo [not markup]\n")
    (folder / "detector-1.log").write_text("three\n")
    status, output, _ = run("logs", "camera", "-n", "1", state=tmp_path)
    assert status == 0
    assert output.split() == ["camera-1", "two", "[not", "markup]"]
    status, _, errors = run("logs", "reid", state=tmp_path)
    assert status == 1
    assert "There are camera-1, detector-1." in errors


def test_latency_is_counted_from_the_first_stage() -> None:
    span = Span(stage="camera.capture", process="c@h", start_ns=1_000_000, end_ns=2_000_000)
    tracks = builders.tracks(camera="c", trace=(span,))
    assert latency_ms(tracks, 31_000_000) == 30.0  # (31 - 1) ms
    assert latency_ms(msgspec.structs.replace(tracks, trace=()), 31_000_000) is None
    assert latency_ms(tracks, 120 * 24 * 3600 * 10**9) is None  # replayed months later


def test_topic_names_select_message_types() -> None:
    assert kinds_of("people, health") == (Tracks, Health)
    assert kinds_of("") == ()


def test_states_count_as_working_or_not() -> None:
    health = builders.health("s", host="h")
    assert works(health)
    assert works(msgspec.structs.replace(health, state="degraded"))
    assert not works(msgspec.structs.replace(health, state="starting"))
    assert not works(msgspec.structs.replace(health, state="stalled"))
    assert not works(None)


@pytest.mark.parametrize(("seconds", "expected"), [(12.9, "12s"), (185, "3m05s"), (7380, "2h03m")])
def test_durations_are_formatted_by_size(seconds: float, expected: str) -> None:
    assert duration(seconds) == expected


def test_tail_returns_the_last_lines(tmp_path: Path) -> None:
    log = tmp_path / "x.log"
    assert tail(log, 3) == ""
    log.write_text("\n".join(str(n) for n in range(5000)))
    assert tail(log, 2) == "4998\n4999"
    assert tail(log, 0) == ""


@pytest.mark.processes
def test_completion_names_commands() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "deploy.cli"],
        env={
            **os.environ,
            "_PEOPLE4D_COMPLETE": "complete_bash",
            "COMP_WORDS": "people4d re",
            "COMP_CWORD": "1",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.stdout.split() == ["record", "replay"]


def test_table_of_people_is_rendered() -> None:
    person = builders.track(
        id=7, position_m=np.array([1.0, -2.0, 0.5]), velocity_mps=np.array([0.3, 0.4, 0.0]), age=4
    )
    tracks = builders.tracks(person, sequence=9, tracker="sort3d")
    console = Console(width=100)
    with console.capture() as capture:
        console.print(table_of(tracks, 0))
    title, _, row = (line.split() for line in capture.get().splitlines())
    assert title[:4] == ["1", "people", "in", "map"]
    # speed = sqrt(0.3^2 + 0.4^2) = 0.5; no heading while standing
    assert row == ["7", "confirmed", "1.00", "-2.00", "0.50", "0.50", "-", "0.90", "4"]
