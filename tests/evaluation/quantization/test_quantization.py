"""Quantisation of a small network, and the order in which layers return to float32."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from common.inference.engines import is_quantized
from common.inference.onnx import OnnxSession
from common.io.weights import locate
from evaluation.quantization.accuracy import AccuracyLoss, compare, detect
from evaluation.quantization.control import candidates, harm
from evaluation.quantization.images import ORIENTATION, images_of
from evaluation.quantization.quantizer import Quantizer
from evaluation.recordings.rendered import RenderedFrame, render
from people4d.errors import ConfigError, ModelError
from people4d.messages import F64
from tests import builders

SIZE = 16  # [px]


def convolutions(path: Path, count: int = 4) -> Path:
    """Write a network of convolutions c0, c1, ..., each with a Relu but the last."""
    chance = np.random.default_rng(0)
    nodes, weights, name = [], [], "images"
    for k in range(count):
        channels = 3 if k == 0 else 4
        values = chance.normal(size=(4, channels, 3, 3)).astype(np.float32) / 4
        weights.append(numpy_helper.from_array(values, f"w{k}"))
        pads = [1, 1, 1, 1]
        nodes.append(helper.make_node("Conv", [name, f"w{k}"], [f"o{k}"], f"c{k}", pads=pads))
        name = f"o{k}"
        if k < count - 1:
            nodes.append(helper.make_node("Relu", [name], [f"r{k}"], f"relu{k}"))
            name = f"r{k}"
    shape = [1, 3, SIZE, SIZE]
    graph = helper.make_graph(
        nodes,
        "convolutions",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 4, SIZE, SIZE])],
        weights,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, str(path))
    return path


def images(count: int = 6) -> list[Any]:
    chance = np.random.default_rng(1)
    return [chance.random((1, 3, SIZE, SIZE)).astype(np.float32) for _ in range(count)]


def quantized_weights(path: Path) -> int:
    return sum(
        tensor.name.endswith("_quantized") for tensor in onnx.load(str(path)).graph.initializer
    )


def output(path: Path, image: Any) -> F64:
    (found,) = OnnxSession(path).run(image).values()
    return np.asarray(found, np.float64).ravel()


@pytest.fixture
def network(tmp_path: Path) -> Path:
    return convolutions(tmp_path / "m.onnx")


def test_quantized_network_gives_nearly_the_same_with_its_ends_in_float(
    network: Path, tmp_path: Path
) -> None:
    quantizer, out = Quantizer(network, images(), tmp_path), tmp_path / "q.onnx"
    assert quantizer.convolutions == ["c0", "c1", "c2", "c3"]
    assert quantizer.ends() == ["c0", "c3"]
    quantizer.write(out, quantizer.ends())
    assert is_quantized(out)
    assert not is_quantized(network)
    (image,) = images(1)
    expected, got = output(network, image), output(out, image)
    assert np.corrcoef(expected, got)[0, 1] > 0.999
    assert (got != expected).any()
    quantizer.write(out, quantizer.convolutions)
    assert np.abs(output(out, image) - expected).max() < np.abs(got - expected).max()


def test_small_scores_beside_large_coordinates_survive(network: Path, tmp_path: Path) -> None:
    model = onnx.load(str(network))
    graph, decoded = model.graph, tmp_path / "decoded.onnx"
    head = graph.output[0].name
    graph.initializer.append(numpy_helper.from_array(np.array(640, np.float32), "width"))
    graph.node.append(helper.make_node("Mul", [head, "width"], ["coordinates"], "scale"))
    graph.node.append(helper.make_node("Sigmoid", [head], ["scores"], "sigmoid"))
    joined = helper.make_node("Concat", ["coordinates", "scores"], ["all"], "join", axis=1)
    graph.node.append(joined)
    del graph.output[:]
    shape = [1, 8, SIZE, SIZE]
    graph.output.append(helper.make_tensor_value_info("all", TensorProto.FLOAT, shape))
    onnx.save(model, str(decoded))
    quantizer, out = Quantizer(decoded, images(), tmp_path), tmp_path / "q.onnx"
    assert quantizer.ends() == ["c0", "c3"]
    quantizer.write(out, quantizer.ends())
    assert is_quantized(out)
    (image,) = images(1)
    expected, got = (output(path, image).reshape(8, -1)[4:].ravel() for path in (decoded, out))
    assert np.corrcoef(expected, got)[0, 1] > 0.99


def test_layer_whose_result_is_an_output_and_is_read_on_stays_in_float(
    network: Path, tmp_path: Path
) -> None:
    model, path = onnx.load(str(network)), tmp_path / "features.onnx"
    shape = [1, 4, SIZE, SIZE]
    model.graph.output.append(helper.make_tensor_value_info("r1", TensorProto.FLOAT, shape))
    onnx.save(model, str(path))
    # c3 hangs on c2 alone, and that on r1, where the path parts.
    assert Quantizer(path, images(), tmp_path).ends() == ["c0", "c1", "c2", "c3"]


def test_harm_of_each_layer_but_the_ends_is_measured(network: Path, tmp_path: Path) -> None:
    reported: list[tuple[int, int]] = []
    found = harm(
        Quantizer(network, images(), tmp_path),
        OnnxSession(network),
        images(2),
        tmp_path / "q.onnx",
        lambda done, of: reported.append((done, of)),
    )
    assert set(found) == {"c1", "c2"}
    assert list(found.values()) == sorted(found.values(), reverse=True)
    assert reported == [(1, 2), (2, 2)]


@pytest.mark.parametrize(
    ("holds_from", "expected"), [(0, [0]), (3, [0, 1, 2, 3]), (99, [0, 1, 2, 3, 4, 6])]
)
def test_layers_go_back_to_float_until_the_network_holds(
    tmp_path: Path, holds_from: int, expected: Sequence[int]
) -> None:
    network, out = convolutions(tmp_path / "m.onnx", 7), tmp_path / "q.onnx"

    def score(path: Path) -> AccuracyLoss:
        floats = 6 - quantized_weights(path)
        return AccuracyLoss(10, 0.0, 0.0 if floats >= holds_from else 0.1, 0.0, 1.0)

    quantizer = Quantizer(network, images(), tmp_path)
    made = list(candidates(quantizer, out, score, lambda: [f"c{k}" for k in range(6)]))
    assert [len(candidate.floats) for candidate in made] == list(expected)
    assert made[-1].loss.acceptable == (holds_from <= 6)
    assert made[-1].floats == [f"c{k}" for k in range(expected[-1])]


def test_network_without_convolutions_is_refused(tmp_path: Path) -> None:
    graph = helper.make_graph(
        [helper.make_node("Add", ["images", "images"], ["twice"])],
        "doubling",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, SIZE, SIZE])],
        [helper.make_tensor_value_info("twice", TensorProto.FLOAT, [1, 3, SIZE, SIZE])],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, str(tmp_path / "m.onnx"))
    with pytest.raises(ModelError, match="cannot be quantised: it has no convolution"):
        Quantizer(tmp_path / "m.onnx", images(), tmp_path)
    with pytest.raises(ConfigError, match="no images"):
        Quantizer(tmp_path / "m.onnx", [], tmp_path)


def test_folder_without_images_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="has no image"):
        list(images_of(tmp_path))
    with pytest.raises(ConfigError, match="cannot be read"):
        list(images_of(tmp_path / "none"))
    (tmp_path / "bad.png").write_bytes(b"no image")
    with pytest.raises(ConfigError, match="cannot be read"):
        list(images_of(tmp_path))


def test_images_of_a_folder_are_red_first(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((2, 3, 3), (10, 20, 30), np.uint8))
    (image,) = images_of(tmp_path)
    assert image[0, 0].tolist() == [30, 20, 10]


def frames_with_one_person() -> list[RenderedFrame]:
    person: Any = msgspec.defstruct("Person", ["yaw_rad"])(0.0)
    position_m = np.array([0.0, 0.0, 3.0])
    frame: Any = None
    return [RenderedFrame(frame, frame, [person], [position_m], np.eye(4))] * 2


def test_losses_are_of_people_whom_both_networks_found() -> None:
    def detection(off_m: float, yaw_deg: float) -> Any:
        yaw = np.radians(yaw_deg)
        heading = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        return builders.detection(position_m=np.array([off_m, 0.0, 3.0]), heading=heading)

    reference = {(0, 0): detection(0.10, 5.0), (1, 0): detection(0.0, 0.0)}
    loss = compare(frames_with_one_person(), reference, {(0, 0): detection(0.12, -7.0)})
    assert (loss.people, loss.recall) == (2, 0.5)
    assert loss.position_m == pytest.approx(0.02)
    assert loss.yaw_deg == pytest.approx(2.0)
    assert not loss.acceptable
    same = compare(frames_with_one_person(), reference, reference)
    assert (same.recall, same.position_m, same.yaw_deg) == (0, 0, 0)
    assert same.acceptable
    assert same.score_scale == 1.0
    assert not compare(frames_with_one_person(), reference, {}).acceptable


def test_a_network_without_yaws_loses_none() -> None:
    def detection(heading: Any) -> Any:
        return builders.detection(position_m=np.array([0.0, 0.0, 3.0]), heading=heading)

    without, with_yaw = {(0, 0): detection(None)}, {(0, 0): detection(np.array([1.0, 0.0, 0.0]))}
    assert compare(frames_with_one_person(), without, without).acceptable
    assert not compare(frames_with_one_person(), with_yaw, without).acceptable


def without_output(path: Path, out: Path) -> Path:
    """Write a network whose last layer has weights of zero."""
    model = onnx.load(str(path))
    last = [node for node in model.graph.node if node.op_type == "Gemm"][-1]
    for tensor in model.graph.initializer:
        if tensor.name in last.input:
            zeros = np.zeros_like(numpy_helper.to_array(tensor))
            tensor.CopyFrom(numpy_helper.from_array(zeros, tensor.name))
    onnx.save(model, str(out))
    return out


def test_the_int8_orientation_network_is_accepted_and_a_blind_one_is_not(tmp_path: Path) -> None:
    frames = list(render([("four_crossing", 22, range(200, 280, 20))]))
    path, quantized = (locate(name)[0] for name in ("orientation-lab", "orientation-lab-int8"))
    reference = detect(path, ORIENTATION, frames)
    assert len(reference) > 5
    int8 = detect(quantized, ORIENTATION, frames)
    assert compare(frames, reference, int8).acceptable
    blind = without_output(path, tmp_path / "blind.onnx")
    assert not compare(frames, reference, detect(blind, ORIENTATION, frames)).acceptable
