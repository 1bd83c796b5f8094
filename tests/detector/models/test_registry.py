from pathlib import Path

import numpy as np
import pytest

from common.inference.session import Session
from common.io import weights
from people4d.errors import ConfigError, ModelError
from people4d.messages import U8
from services.detector.config import ModelSettings, shipped_model
from services.detector.models.base import DetectedPerson
from services.detector.models.registry import MODELS, find_factory, kind_of, load_model
from tests.detector.models.graphs import write_network


class NoPeople:
    """A user's own model."""

    def __init__(self, session: Session, settings: ModelSettings, name: str) -> None:
        self.name = name

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        return []


def test_default_model_finds_no_person_in_a_grey_image() -> None:
    model = load_model(ModelSettings())
    assert model.name == shipped_model()
    assert model.detect(np.full((480, 640, 3), 128, np.uint8)) == []


@pytest.mark.parametrize("kind", MODELS)
def test_registry_is_complete(kind: str) -> None:
    assert callable(find_factory(kind))


def test_own_model_by_module_and_class() -> None:
    kind = f"{__name__}:NoPeople"
    assert isinstance(load_model(ModelSettings(kind=kind)), NoPeople)


@pytest.mark.parametrize("kind", ["yolo", "osnet", "no.module:Class", f"{__name__}:Absent"])
def test_unknown_kind(kind: str) -> None:
    with pytest.raises(ConfigError, match=r"people model .* (is unknown|cannot be loaded)"):
        load_model(ModelSettings(kind=kind))


def test_model_of_the_wrong_kind() -> None:
    with pytest.raises(ModelError, match=f"{shipped_model()}: expected"):
        load_model(ModelSettings(kind="yolov8-pose"))


def test_model_of_another_service() -> None:
    with pytest.raises(ConfigError, match="people model 'osnet' is unknown"):
        find_factory(weights.load_manifest()["osnet-x0.25-msmt17"].kind)


def test_altered_file_is_refused(tmp_path: Path) -> None:
    good = (weights.REPOSITORY / "models" / "movenet-multipose.onnx").read_bytes()
    (tmp_path / "movenet-multipose.onnx").write_bytes(good[:-1] + bytes([good[-1] ^ 1]))
    with pytest.raises(ModelError, match="expected sha256"):
        load_model(ModelSettings(model="movenet-multipose", folder=str(tmp_path)))


def test_file_that_is_no_network(tmp_path: Path) -> None:
    path = tmp_path / "x.onnx"
    with pytest.raises(ModelError, match="does not exist"):
        load_model(ModelSettings(model=str(path)))
    path.write_bytes(b"\0" * 1000)
    with pytest.raises(ModelError, match="cannot be loaded"):
        load_model(ModelSettings(model=str(path)))


def test_kind_is_recognised_by_the_outputs() -> None:
    def zeros(*shape: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
        return np.zeros(shape, np.float32)

    assert kind_of({"output0": zeros(1, 56, 8400)}) == "yolov8-pose"
    assert kind_of({"a": zeros(1, 116, 5), "b": zeros(1, 32, 16, 16)}) == "yolov8-seg"
    assert kind_of({"output0": zeros(1, 300, 57)}) == "yolov8-pose"  # with NMS inside
    assert kind_of({"a": zeros(1, 300, 38), "b": zeros(1, 32, 16, 16)}) == "yolov8-seg"
    assert kind_of({"center": zeros(1, 1, 4, 4), "kpt_heatmap": zeros(1, 17, 4, 4)}) == "movenet"
    assert kind_of({"output": zeros(1, 512)}) == ""


@pytest.mark.parametrize("shape", [(1, 300, 6), (1, 84, 1680), (1, 5, 1680)])
def test_network_that_finds_boxes_only_is_refused_by_name(
    shape: tuple[int, ...], tmp_path: Path
) -> None:
    path = write_network(tmp_path / "a.onnx", {"output0": np.zeros(shape, np.float32)}, (256, 320))
    with pytest.raises(ModelError, match=r"boxes only.*export a pose or .* set detector\.boxes"):
        load_model(ModelSettings(model=str(path)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("yolov8n-pose_640", "yolov8-pose:yolov8n-pose_640"),
        ("yolov8n-seg_640", "yolov8-seg:yolov8n-seg_640"),
        ("movenet_multipose_heads.f16w", "movenet:movenet_multipose_heads.f16w"),
    ],
)
def test_file_by_path(shared: Path, file: str, name: str) -> None:
    path = shared / "data" / "models" / f"{file}.onnx"
    assert load_model(ModelSettings(model=str(path))).name == name


def test_file_of_no_known_kind(shared: Path) -> None:
    path = shared / "data" / "models" / "osnet_x0_25_msmt17.onnx"
    with pytest.raises(ModelError, match=r"its outputs are output \(1, 512\).*Known outputs: yolo"):
        load_model(ModelSettings(model=str(path)))
