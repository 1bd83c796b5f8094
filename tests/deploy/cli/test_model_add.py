from pathlib import Path

import numpy as np
import pytest

from common.io.weights import known_models
from deploy.cli.data.model_add import LACKS, demo_frame
from people4d.messages import F32
from services.detector.config import ModelSettings
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
