"""Sessions of both engines on networks of one node, built in the tests."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from common.inference import engines
from common.inference.engines import open_session
from common.inference.onnx import OnnxSession
from common.inference.session import Array, Engine, Session
from common.io.weights import MANIFEST
from common.transport.trace import ProcessId, collect
from people4d.errors import ConfigError, ModelError
from people4d.messages import F64

ENGINES: tuple[Engine, ...] = get_args(Engine)


def doubling(path: Path, kind: int, shape: list[int | str]) -> Path:
    """Write a network that adds its input to itself."""
    graph = helper.make_graph(
        [helper.make_node("Add", ["images", "images"], ["twice"])],
        "doubling",
        [helper.make_tensor_value_info("images", kind, shape)],
        [helper.make_tensor_value_info("twice", kind, shape)],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, str(path))
    return path


def test_a_network_runs_and_has_its_input_shape(tmp_path: Path) -> None:
    session = OnnxSession(doubling(tmp_path / "m.onnx", TensorProto.FLOAT, [1, "n", 2]))
    assert session.input_shape == (1, None, 2)
    assert session.input_dtype == np.float32
    with collect(ProcessId("detector", "d", "h")) as spans:
        outputs = session.run(np.array([[[1, 2], [3, 4]]], np.float32))
    np.testing.assert_array_equal(outputs["twice"], [[[2, 4], [6, 8]]])
    assert [s.stage for s in spans] == ["detector.inference_wait", "detector.inference"]


@pytest.mark.parametrize(
    ("kind", "dtype"), [(TensorProto.FLOAT16, np.float16), (TensorProto.FLOAT, np.float32)]
)
def test_input_type_is_read(tmp_path: Path, kind: int, dtype: type[np.floating]) -> None:
    session = OnnxSession(doubling(tmp_path / "m.onnx", kind, [2]))
    assert session.input_dtype == dtype
    np.testing.assert_array_equal(session.run(np.array([1, 2], dtype))["twice"], [2, 4])


def test_the_session_can_run_again_after_a_run_that_failed(tmp_path: Path) -> None:
    session = OnnxSession(doubling(tmp_path / "m.onnx", TensorProto.FLOAT, [2]))
    with pytest.raises(Exception, match="Got: 3 Expected: 2"):
        session.run(np.zeros(3, np.float32))
    np.testing.assert_array_equal(session.run(np.ones(2, np.float32))["twice"], [2, 2])


def test_an_absent_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"none\.onnx does not exist. See: people4d models"):
        OnnxSession(tmp_path / "none.onnx")


@pytest.mark.parametrize("content", [b"", b"not a network", b"\x08\x08" + bytes(99)])
def test_a_broken_file_is_reported(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.onnx"
    path.write_bytes(content)
    with pytest.raises(ModelError, match=r"broken\.onnx cannot be loaded: "):
        OnnxSession(path)


@pytest.fixture
def movenet() -> Path:
    return MANIFEST.parent / "movenet-multipose.onnx"


def outputs(session: Session, image: Array) -> dict[str, F64]:
    return {name: np.asarray(array, np.float64) for name, array in session.run(image).items()}


def test_both_engines_give_the_same(movenet: Path) -> None:
    image = np.random.default_rng(0).integers(0, 255, (1, 64, 96, 3), np.uint8)
    one, other = (open_session(movenet, engine=engine) for engine in ENGINES)
    assert one.input_shape == other.input_shape == (1, None, None, 3)
    assert one.input_dtype == other.input_dtype == np.uint8
    expected, got = outputs(one, image), outputs(other, image)
    assert list(expected) == list(got)
    for name, array in expected.items():
        np.testing.assert_allclose(got[name], array, atol=2e-4 * float(np.abs(array).max()))


def test_openvino_runs_batches_and_images_of_any_size(tmp_path: Path) -> None:
    session = open_session(
        doubling(tmp_path / "m.onnx", TensorProto.FLOAT, ["n", "w"]), 1, "openvino"
    )
    for shape in ((1, 2), (3, 2), (1, 5), *((1, 10 + n) for n in range(9))):
        values = np.arange(np.prod(shape), dtype=np.float32).reshape(shape)
        np.testing.assert_array_equal(session.run(values)["twice"], 2 * values)


@pytest.mark.parametrize("engine", ENGINES)
def test_no_engine_opens_an_absent_or_broken_file(tmp_path: Path, engine: Engine) -> None:
    with pytest.raises(ModelError, match="does not exist"):
        open_session(tmp_path / "none.onnx", 1, engine)
    path = tmp_path / "broken.onnx"
    path.write_bytes(b"not a network")
    with pytest.raises(ModelError, match=r"broken\.onnx cannot be loaded: "):
        open_session(path, 1, engine)


def test_engine_that_is_not_installed_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "openvino", None)
    path = doubling(tmp_path / "m.onnx", TensorProto.FLOAT, [2])
    with pytest.raises(ConfigError, match=r"not installed. Install it: .* -m pip"):
        open_session(path, 1, "openvino")


def quantized(path: Path) -> Path:
    """Write a network that rounds its input to 8 bits and back."""
    scale, zero = np.float32(0.01), np.uint8(0)
    constants = [numpy_helper.from_array(np.array(c), n) for c, n in ((scale, "s"), (zero, "z"))]
    graph = helper.make_graph(
        [
            helper.make_node("QuantizeLinear", ["images", "s", "z"], ["q"]),
            helper.make_node("DequantizeLinear", ["q", "s", "z"], ["rounded"]),
        ],
        "rounding",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, "n"])],
        [helper.make_tensor_value_info("rounded", TensorProto.FLOAT, [1, "n"])],
        constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, str(path))
    return path


def test_network_of_integers_that_cannot_be_run_fused_runs_as_in_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    path, run = quantized(tmp_path / "m.onnx"), OnnxSession.run

    def failing(self: OnnxSession, image: Array) -> Mapping[str, Array]:
        if self.optimised:
            raise RuntimeError("zero point must be a scalar\nand more")
        return run(self, image)

    monkeypatch.setattr(OnnxSession, "run", failing)
    session = open_session(path)
    assert "onnxruntime cannot run it fused: zero point must be a scalar; it runs" in caplog.text
    found = outputs(session, np.array([[0.004, 0.5, 0.996]], np.float32))
    np.testing.assert_allclose(found["rounded"], [[0, 0.5, 1.0]], atol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("fast", [True, False])
def test_network_of_integers_is_compared_with_its_file(
    tmp_path: Path,
    engine: Engine,
    fast: bool,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    path = quantized(tmp_path / "m.onnx")
    values = np.array([[0.004, 0.5, 0.996]], np.float32)
    session = open_session(path, 1, engine)
    np.testing.assert_allclose(outputs(session, values)["rounded"], [[0, 0.5, 1.0]], atol=1e-6)
    assert not caplog.records
    kind = type(session)
    run = kind.run

    def wrong(self: Any, image: Array) -> Mapping[str, Array]:
        found: Mapping[str, Array] = run(self, image)
        plain = isinstance(self, OnnxSession) and not self.optimised
        return found if plain else {name: np.zeros_like(a) for name, a in found.items()}

    monkeypatch.setattr(kind, "run", wrong)
    monkeypatch.setattr(engines, "has_integer_dot_products", lambda: fast)
    session = open_session(path, 1, engine)
    assert "another result than the file says" in caplog.text
    assert ("use a float network on this processor" in caplog.text) is not fast
    np.testing.assert_allclose(outputs(session, values)["rounded"], [[0, 0.5, 1.0]], atol=1e-6)
