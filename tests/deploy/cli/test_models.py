"""The commands of models: install, time, quantise."""

import os
from pathlib import Path

import msgspec
import numpy as np
import pytest

from common.config import load
from common.inference.session import Engine
from common.io.weights import ModelFile, known_models
from deploy.cli.data.model_add import LACKS, demo_frame
from deploy.cli.data.model_times import fastest_engine, store_engine
from deploy.cli.data.models import state_of
from people4d.errors import ConfigError
from people4d.messages import F32
from services.detector.config import DetectorConfig, ModelSettings
from services.detector.models.registry import MODELS, load_model
from tests.deploy.cli.test_cli import run
from tests.detector.models.graphs import write_network


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Empty folder of the user's models."""
    monkeypatch.setenv("PEOPLE4D_MODELS", str(tmp_path / "own"))
    return tmp_path / "own"


def pose(path: Path) -> Path:
    """A network that finds two people in any image, with NMS inside."""
    rows: F32 = np.zeros((1, 300, 57), np.float32)
    rows[0, :2, :5] = [[50, 60, 90, 200, 0.9], [150, 60, 190, 200, 0.8]]
    return write_network(path, {"output0": rows}, (256, 320))


def test_added_model_is_found_by_its_name(own: Path, tmp_path: Path) -> None:
    file = pose(tmp_path / "yolo26n-pose.onnx")
    status, output, errors = run("models", "add", str(file))
    assert (status, errors) == (0, "")
    assert "kind yolov8-pose, input 1x3x256x320" in output
    assert "it found 2, in " in output
    assert "It has no masks" in output
    assert '[detector] model = "yolo26n-pose"' in output
    file.unlink()
    model = load_model(ModelSettings(model="yolo26n-pose"))
    assert model.name == "yolo26n-pose"
    assert len(model.detect(demo_frame())) == 2
    assert (own / "yolo26n-pose.onnx").is_file()


def test_second_model_joins_the_first_under_a_name_of_its_own(own: Path, tmp_path: Path) -> None:
    file = pose(tmp_path / "a.onnx")
    assert run("models", "add", str(file))[0] == 0
    assert run("models", "add", str(file), "--name", "b")[0] == 0
    assert list(known_models())[-2:] == ["a", "b"]
    _, output, _ = run("models", "--verify")
    assert output.count("verified") >= 4  # MoveNet twice, and both
    (own / "b.onnx").write_bytes(b"x")
    status, _, errors = run("models", "--verify")
    assert (status, "b differs from its checksum" in errors) == (1, True)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("movenet-multipose", "is another file. Choose another name by --name"),
        ("../a", "is not plain. Choose letters"),
    ],
)
def test_wrong_name_is_refused(own: Path, tmp_path: Path, name: str, message: str) -> None:
    status, _, errors = run("models", "add", str(pose(tmp_path / "a.onnx")), "--name", name)
    assert (status, message in errors) == (1, True), errors
    assert not own.exists()


def test_file_of_no_known_kind_is_refused_with_the_known_kinds(own: Path, tmp_path: Path) -> None:
    file = write_network(tmp_path / "a.onnx", {"y": np.zeros((1, 512), np.float32)}, (256, 320))
    status, _, errors = run("models", "add", str(file))
    assert status == 1
    assert "has an unsupported format: its outputs are y (1, 512)" in errors
    assert "yolov8-pose 1x56xN" in errors
    (tmp_path / "a.txt").touch()
    for name, message in (("a.txt", "is not an .onnx file"), ("b.onnx", "does not exist")):
        status, _, errors = run("models", "add", str(tmp_path / name))
        assert (status, f"{name} {message}" in errors) == (1, True)
    assert not own.exists()


def test_folder_that_cannot_be_written_is_reported(own: Path, tmp_path: Path) -> None:
    own.write_text("a file")
    status, _, errors = run("models", "add", str(pose(tmp_path / "a.onnx")))
    assert (status, "cannot be written" in errors) == (1, True)


def test_each_kind_has_its_lacks() -> None:
    assert LACKS.keys() == MODELS.keys()


def test_models_lists_which_files_are_present(tmp_path: Path) -> None:
    fields = {"name": "m", "kind": "k", "licence": "l", "input": "i", "get": "g"}
    # sha256 of the three bytes "abc", FIPS 180-2 appendix B.1
    digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    known = msgspec.convert({**fields, "file": "m.onnx", "sha256": digest}, ModelFile)
    anything = msgspec.structs.replace(known, sha256="")
    assert state_of(known, (tmp_path,), check=True) == "absent"
    (tmp_path / "m.onnx").write_bytes(b"abc")
    assert state_of(known, (tmp_path,), check=False) == "present"
    assert state_of(known, (tmp_path,), check=True) == "verified"
    assert state_of(anything, (tmp_path,), check=True) == "any export"
    (tmp_path / "m.onnx").write_bytes(b"xyz")
    assert state_of(known, (tmp_path,), check=True) == "altered"


@pytest.mark.slow
def test_detection_models_are_timed_with_each_engine_and_the_fastest_is_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "people4d.toml"
    file.write_text('[detector]\nmodel = "movenet-multipose"\n')
    monkeypatch.setenv("PEOPLE4D_DETECTOR_ENGINE", "onnxruntime")
    status, output, errors = run(
        *("models", "benchmark", "--seconds", "0.1", "--config", str(file), "--store")
    )
    assert status == 0, errors
    rows = [line.split() for line in output.splitlines() if line.startswith("movenet-multipose ")]
    assert [row[1] for row in rows] == ["onnxruntime", "openvino"]
    assert all(float(row[2]) > 0 for row in rows)
    words = " ".join(output.split())
    engine = load(DetectorConfig, "detector", file, environment={}).engine
    best = [row[1] for row in rows if row[-1] == "fastest"]
    assert best == [engine]
    assert f"model movenet-multipose: --set detector.engine={engine} Stored in" in words
    assert words.endswith("PEOPLE4D_DETECTOR_ENGINE overrides it.")
    assert 'engine = "' in file.read_text()
    assert "Instructions that decide: " in words


def test_orientation_networks_need_depth(tmp_path: Path) -> None:
    status, _, errors = run("models", "quantize", "orientation-lab", "--images", str(tmp_path))
    assert status == 1
    assert "orientation networks need depth" in errors


def test_fastest_engine_is_of_the_configured_model() -> None:
    times_ms: dict[tuple[str, Engine], list[float]] = {
        ("slow", "onnxruntime"): [9.0, 9.0, 1.0],
        ("slow", "openvino"): [8.0, 8.0, 99.0],
        ("fast", "onnxruntime"): [1.0],
    }
    assert fastest_engine("slow", times_ms) == "openvino"
    assert fastest_engine("absent", times_ms) is None


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (b"", b'\n\n[detector]\nengine = "openvino"\n'),
        (
            b'[tracker]\ntracker = "sort3d"',
            b'[tracker]\ntracker = "sort3d"\n\n[detector]\nengine = "openvino"\n',
        ),
        (b"[detector]", b'[detector]\nengine = "openvino"\n'),
        (
            b'[detector]\n# text\nengine = "onnxruntime"  # slow\n\n[reid]\nengine = "none"\n',
            b'[detector]\n# text\nengine = "openvino"  # slow\n\n[reid]\nengine = "none"\n',
        ),
        (
            b"[detector]\r\n  engine='onnxruntime' # slow\r\n  [reid]\r\n  engine = 'none'\r\n\r\n",
            b"[detector]\r\n  engine=\"openvino\" # slow\r\n  [reid]\r\n  engine = 'none'\r\n\r\n",
        ),
        (b"[detector]\r\nthreads = 2", b'[detector]\r\nengine = "openvino"\r\nthreads = 2\r\n'),
        (b"[gait]\r\n", b'[gait]\r\n\r\n[detector]\r\nengine = "openvino"\r\n'),
        (
            b"[plugin]\nx = [nan, 2026-11-29]\n[detector]\n",
            b'[plugin]\nx = [nan, 2026-11-29]\n[detector]\nengine = "openvino"\n',
        ),
    ],
)
def test_engine_is_stored_in_the_configuration_file(
    tmp_path: Path, before: bytes, after: bytes
) -> None:
    file = tmp_path / "people4d.toml"
    file.write_bytes(before)
    store_engine(file, "openvino")
    assert file.read_bytes() == after
    assert load(DetectorConfig, "detector", file, environment={}).engine == "openvino"


@pytest.mark.parametrize(
    "text",
    [
        "detector = {threads = 2}",
        "detector.threads = 2",
        " [detector]\nthreads = 2",
        '[detector]\n"engine" = "onnxruntime"',
        '[detector]\nkind = """\nengine = "onnxruntime"\n"""',
        "[",
    ],
)
def test_engine_is_not_stored_in_a_file_of_another_form(tmp_path: Path, text: str) -> None:
    file = tmp_path / "people4d.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match="cannot be stored") as caught:
        store_engine(file, "openvino")
    assert caught.value.hint == 'Write it yourself, below [detector]: engine = "openvino"'
    assert file.read_text() == text


def test_pipe_is_not_replaced_by_a_stored_engine(tmp_path: Path) -> None:
    pipe = tmp_path / "people4d.toml"
    os.mkfifo(pipe)
    with pytest.raises(ConfigError, match="it is not a regular file"):
        store_engine(pipe, "openvino")
    status, output, errors = run("models", "benchmark", "--config", str(pipe), "--store")
    assert (status, output) == (1, "")
    assert "it is not a regular file" in errors
    assert pipe.is_fifo()


def test_read_only_file_is_not_replaced_by_a_stored_engine(tmp_path: Path) -> None:
    file = tmp_path / "people4d.toml"
    file.write_text("[detector]\n")
    file.chmod(0o444)
    with pytest.raises(ConfigError, match="it is read-only"):
        store_engine(file, "openvino")
    status, output, errors = run("models", "benchmark", "--config", str(file), "--store")
    assert (status, output) == (1, "")
    assert "it is read-only. Choose a writable file by --config." in errors
    assert file.read_text() == "[detector]\n"


def test_engine_of_a_model_that_cannot_be_measured_is_not_stored(own: Path, tmp_path: Path) -> None:
    assert run("models", "add", str(pose(tmp_path / "a.onnx")))[0] == 0
    (own / "a.onnx").write_bytes(b"x")
    file = tmp_path / "people4d.toml"
    file.write_text('[detector]\nmodel = "a"\n')
    status, output, errors = run("models", "benchmark", "--config", str(file), "--store")
    assert status == 1
    assert "a, onnxruntime: " in output
    assert "the configured model a cannot be measured, so no engine is stored" in errors
    assert file.read_text() == '[detector]\nmodel = "a"\n'
