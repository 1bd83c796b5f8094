"""The ONNX session on networks of one node, made here."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from common.inference import OnnxSession
from common.transport.trace import ProcessId, collect
from people4d.errors import ModelError


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
