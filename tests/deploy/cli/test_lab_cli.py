"""people4d lab."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from typer.testing import CliRunner

from common.io.recording import open_recording
from deploy.cli import app
from lab.catalogue import is_scenario, resolve, scenario_names, truth_settings
from lab.depth.metadata import read_metadata
from people4d.errors import ConfigError
from people4d.messages import Detections
from tests.lab.scenarios import FRAMES, write_scenario

pytestmark = [pytest.mark.processes, pytest.mark.render]


def run(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["lab", *map(str, arguments)])
    return result.exit_code, result.stdout, result.stderr


def test_list_shows_scenarios_and_people() -> None:
    status, output, _ = run("list")
    assert status == 0
    for name in (*scenario_names(), "adam", "twin_a", "twin_b"):
        assert name in output


@pytest.mark.parametrize("command", ["list", "render", "preview", "export"])
def test_every_command_has_help(command: str) -> None:
    status, output, _ = run(command, "--help")
    assert status == 0
    assert "Usage: people4d lab" in output.replace("root", "people4d")


def test_render_preview_and_export(tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path)
    status, output, errors = run(
        "render",
        scenario,
        "--fidelity",
        "depth",
        "--out",
        tmp_path,
        "--jobs",
        1,
        "--format",
        "both",
    )
    assert (status, "Wrote" in output) == (0, True), errors
    assert open_recording(tmp_path / "walk.mcap").summary.topics["raw/front/compressed"] == FRAMES
    assert (tmp_path / "walk_ros2" / "metadata.yaml").is_file()
    status, output, _ = run("export", tmp_path / "walk.mcap", tmp_path / "small", "--compressed")
    assert status == 0
    assert f"{FRAMES:>8} /camera/color/image_raw/compressed" in output
    status, _, _ = run(
        "preview", scenario, "--fidelity", "depth", "--out", tmp_path / "p.png", "--every", 0.6
    )
    assert status == 0
    assert (tmp_path / "p.png").is_file()


def test_given_seed_is_in_the_file_name(tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path)
    status, _, _ = run("render", scenario, "--fidelity", "geometry", "--out", tmp_path, "--seed", 7)
    assert status == 0
    assert (tmp_path / "walk-7.mcap").is_file()


def test_sensor_errors_are_configurable(tmp_path: Path) -> None:
    """A detector that finds no person and a sensor with twice the noise, which the file notes."""
    settings = ["--set", "detector.recall=0", "--set", "sensor.noise_px=0.14"]
    settings += ["--set", "detector.false_alarms=0"]
    arguments = ["--fidelity", "geometry", "--out", tmp_path, *settings]
    assert run("render", write_scenario(tmp_path), *arguments)[0] == 0
    recording = open_recording(tmp_path / "walk.mcap")
    found = [m for _, m in recording.messages(Detections) if isinstance(m, Detections)]
    assert [len(m.detections) for m in found] == [0] * FRAMES
    note = read_metadata(recording)
    assert note is not None
    assert note.sensor.noise_px == 0.14


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["render", "nothing"], "unknown scenario nothing. There are "),
        (["preview", "nothing"], "unknown scenario nothing. There are "),
        (["preview", "two_easy", "--out", "p.gif"], "--out: expected a .png or .webm file"),
        (
            ["render", "two_easy", "--fidelity", "geometry", "--format", "ros2"],
            "a ROS bag needs images",
        ),
        (["render", "two_easy", "--set", "sensor.noize_px=1"], "Did you mean noise_px?"),
        (["render", "two_easy", "--set", "sensor.noise_px=-1"], "noise_px: expected `float` >= 0"),
        (["export", "/none.mcap", "/tmp/none"], "recording /none.mcap cannot be read"),
    ],
)
def test_errors_are_one_sentence_with_a_hint(arguments: list[str], message: str) -> None:
    status, _, errors = run(*arguments)
    assert status == 1
    assert message in errors
    assert "Traceback" not in errors


def test_existing_output_is_reported(tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path)
    (tmp_path / "walk.mcap").write_text("precious")
    status, _, errors = run("render", scenario, "--out", tmp_path)
    assert status == 1
    assert "walk.mcap exists already. Remove it, or give another --out" in errors


def test_stopped_rendering_says_how_to_continue(tmp_path: Path) -> None:
    """SIGTERM while frames are drawn; the same command then finishes the recording."""
    scenario = write_scenario(tmp_path, camera="exposure_s = 0.02")
    # Seconds of drawing, so that it is not complete when a busy host runs this test next
    scenario.write_text(scenario.read_text().replace("duration_s = 1.2", "duration_s = 4.0"))
    command = [sys.executable, "-m", "deploy.cli", "lab", "render", str(scenario)]
    command += ["--out", str(tmp_path), "--jobs", "1", "--samples", "1"]
    environment = os.environ | {"TERM": "dumb"}
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    )
    chunks = tmp_path / "walk.mcap.part"
    while process.poll() is None and not any(chunks.glob("*.new")):
        with suppress(subprocess.TimeoutExpired):
            process.wait(0.05)
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert f"Finished frames are in {chunks}" in errors
    assert (chunks / "key").is_file()
    assert run("render", scenario, "--out", tmp_path, "--jobs", 1, "--samples", 1)[0] == 0
    assert not chunks.exists()


def test_up_reads_scenarios_and_their_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert is_scenario("lab:two_easy")
    assert not is_scenario("lab/two_easy.mcap")
    assert resolve("lab:two_easy@3") == "lab:two_easy@3"
    path = write_scenario(tmp_path)
    monkeypatch.chdir(tmp_path)  # services run elsewhere
    assert resolve("lab:walk.toml@3") == f"lab:{path}@3"
    with pytest.raises(ConfigError, match="unknown scenario nothing"):
        resolve("lab:nothing")
    source = 'gt_bridge.source="lab.source:LabTruth"'
    assert truth_settings(f"lab:{path}@3", loop=False) == [source]
    # 1.2 s at 10 Hz are 12 frames: the next round begins 1.2 s later.
    assert truth_settings(f"lab:{path}@3", loop=True) == [source, "gt_bridge.loop_s=1.2"]
