"""Networks of random weights in the shapes of real exports, written as ONNX files."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from people4d.messages import F32


def write_network(
    path: Path,
    outputs: Mapping[str, F32],
    size: tuple[int, int] = (640, 640),
    weight: float = 0.0,
    batch: int | str = 1,
) -> Path:
    """Write a network 1x3xHxW: given arrays, times 1 plus the mean colour times random weights.

    Args:
        path: The file to write.
        outputs: Outputs of a black image, by name.
        size: Height and width of the input.
        weight: Standard deviation of the weights.
        batch: First axis of the input.
    """
    rng = np.random.default_rng(0)
    nodes = [helper.make_node("ReduceMean", ["images"], ["mean"], axes=[2, 3], keepdims=0)]
    constants, values = [], []
    for name, array in outputs.items():
        weights = (weight * rng.standard_normal((3, array.size))).astype(np.float32)
        for suffix, constant in (
            ("w", weights),
            ("b", array.reshape(1, -1).astype(np.float32)),
            ("s", np.array(array.shape, np.int64)),
        ):
            constants.append(numpy_helper.from_array(constant, name + suffix))
        nodes += [
            helper.make_node("MatMul", ["mean", f"{name}w"], [f"{name}x"]),
            helper.make_node("Mul", [f"{name}x", f"{name}b"], [f"{name}y"]),
            helper.make_node("Add", [f"{name}y", f"{name}b"], [f"{name}z"]),
            helper.make_node("Reshape", [f"{name}z", f"{name}s"], [name]),
        ]
        values.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, array.shape))
    image = helper.make_tensor_value_info("images", TensorProto.FLOAT, [batch, 3, *size])
    graph = helper.make_graph(nodes, "random", [image], values, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, str(path))
    return path
