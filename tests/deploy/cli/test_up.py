"""Options of people4d up: its source, its help."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from deploy.cli import app
from deploy.cli.system import demo, up
from deploy.launcher.plan import LaunchRequest
from evaluation.gait.report import read_run
from tests import DEMO


@pytest.fixture
def requested(monkeypatch: pytest.MonkeyPatch) -> list[LaunchRequest]:
    requests: list[LaunchRequest] = []
    monkeypatch.setattr(up, "launch", lambda request, *_: requests.append(request))
    return requests


def settings(requests: list[LaunchRequest], *arguments: str) -> set[str]:
    result = CliRunner().invoke(app, ["up", *arguments])
    assert result.exit_code == 0, result.stderr
    return set(requests[-1].settings)


def test_demo_is_the_shipped_recording_with_its_truth(requested: list[LaunchRequest]) -> None:
    found = settings(requested, "demo", "--loop")
    assert f"camera.source='{DEMO}'" in {text.replace('"', "'") for text in found}
    assert "camera.loop=true" in found
    assert any(text.startswith("gt_bridge.truth=") and str(DEMO) in text for text in found)


def test_report_knows_the_truth_that_is_asked_for(
    requested: list[LaunchRequest], tmp_path: Path
) -> None:
    truth = f"report.truth='{DEMO}'"
    asked = settings(requested, str(DEMO), "--truth", str(DEMO), "--report", str(tmp_path))
    assert truth in {text.replace('"', "'") for text in asked}
    without = settings(requested, str(DEMO), "--report", str(tmp_path))
    assert not any(text.startswith("report.truth") for text in without)


@pytest.mark.parametrize("playback", ["recorded", "lockstep"])
def test_demo_plays_at_the_recorded_rate_unless_lockstep_is_asked_for(
    playback: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    requests: list[LaunchRequest] = []
    monkeypatch.setattr(demo, "launch", lambda request, *_, **__: requests.append(request))
    asked = ["--playback", "lockstep"] if playback == "lockstep" else []
    result = CliRunner().invoke(app, ["demo", *asked])
    assert result.exit_code == 0, result.stderr
    found = {text.replace('"', "'") for text in requests[-1].settings}
    assert f"camera.playback='{playback}'" in found
    assert ("tracker.reorder_wait_s=4.0" in found) == (playback == "lockstep")


def test_file_without_option_is_the_source(requested: list[LaunchRequest], tmp_path: Path) -> None:
    file = tmp_path / "my.bag"
    file.touch()
    assert settings(requested, str(file)) == settings(requested, "--source", str(file))


def test_gait_uses_the_model_of_the_gait_command_unless_one_is_chosen(
    requested: list[LaunchRequest], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PEOPLE4D_DETECTOR_MODEL", raising=False)
    models = [
        [text for text in requested[-1].settings if text.startswith("detector.model=")]
        for arguments in ([], ["--gait"], ["--gait", "--model", "a"], ["--gait", "--config", "c"])
        if settings(requested, "demo", *arguments)
    ]
    ours = f'detector.model="{read_run("demo", None, "", ()).method.detector.model}"'
    assert models == [[], [ours], [ours, 'detector.model="a"'], []]  # a later one wins


def test_two_sources_are_rejected(requested: list[LaunchRequest]) -> None:
    result = CliRunner().invoke(app, ["up", "demo", "--source", "lab:two_crossing"])
    assert result.exit_code == 2
    assert "two sources" in result.stderr


def test_help_of_up_has_panels_and_flags_without_a_type() -> None:
    output = CliRunner().invoke(app, ["up", "--help"], env={"COLUMNS": "140"}).stdout
    panels = ("Source", "Methods", "Extras", "Network")
    lines = [output.index(f"─ {panel} ─") for panel in panels]
    assert lines == sorted(lines)
    assert "<bool>" not in output
    assert "BOOLEAN" not in output
