"""Conversion of TensorFlow's operators to ONNX."""

import base64
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx
from onnx import TensorProto, helper, numpy_helper

Array = npt.NDArray[Any]
Node = dict[str, Any]


class Graph:
    """An ONNX graph under construction, with images in NCHW.

    Args:
        source: Nodes of the TensorFlow graph by name.
        weights: Values of its constants by name.
    """

    def __init__(self, source: Mapping[str, Node], weights: Mapping[str, Array]) -> None:
        self.source = source
        self.weights = weights
        self.values: dict[str, str] = {}  # TensorFlow name -> ONNX name
        self.nodes: list[onnx.NodeProto] = []
        self.initialisers: list[onnx.TensorProto] = []

    def add(self, operator: str, *inputs: str, **attributes: Any) -> str:
        """Append an operator and return the name of its output."""
        output = f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [output], output, **attributes))
        return output

    def constant(self, array: Array) -> str:
        """Append an array and return its name."""
        name = f"constant_{len(self.initialisers)}"
        self.initialisers.append(numpy_helper.from_array(np.require(array, requirements="C"), name))
        return name

    def half(self, array: Array) -> str:
        """Append a half-precision array and return the name of its float32 value."""
        return self.add("Cast", self.constant(array.astype(np.float16)), to=TensorProto.FLOAT)

    def operand(self, name: str) -> str:
        """Return an image, or a constant with the shape of an image."""
        if name not in self.weights:
            return self.values[name]
        array = self.weights[name]
        nhwc = array.reshape((1,) * (4 - array.ndim) + array.shape)
        return self.half(nhwc.transpose(0, 3, 1, 2))


def placeholder(graph: Graph, _node: Node) -> str:
    """The camera's image, HWC bytes, transposed before the conversion to float32."""
    return graph.add("Transpose", "images", perm=[0, 3, 1, 2])


def cast(graph: Graph, node: Node) -> str:
    """Pixels to float32."""
    return graph.add("Cast", graph.values[node["input"][0]], to=TensorProto.FLOAT)


def elementwise(operator: str) -> Callable[[Graph, Node], str]:
    """Return the conversion of an operator on images and constants."""

    def emit(graph: Graph, node: Node) -> str:
        return graph.add(operator, *map(graph.operand, node["input"]))

    return emit


def convolution(graph: Graph, node: Node) -> str:
    """Convolution of all channels: weights are height, width, in, out."""
    weights = graph.weights[node["input"][1]]
    return convolve(graph, node, weights.transpose(3, 2, 0, 1), groups=1)


def depthwise(graph: Graph, node: Node) -> str:
    """Convolution channel by channel: weights are height, width, channel, multiplier."""
    weights = graph.weights[node["input"][1]]
    height, width, channels, multiplier = weights.shape
    rows = weights.transpose(2, 3, 0, 1).reshape(channels * multiplier, 1, height, width)
    return convolve(graph, node, rows, groups=channels)


def convolve(graph: Graph, node: Node, weights: Array, groups: int) -> str:
    """Convolution with fused bias and activation."""
    fused = texts(node, "fused_ops")
    inputs = [graph.values[node["input"][0]], graph.half(weights)]
    if "BiasAdd" in fused:
        inputs.append(graph.half(graph.weights[node["input"][2]]))
    strides = numbers(node, "strides")[1:3]
    same = base64.b64decode(node["attr"]["padding"]["s"]) == b"SAME"
    pads = same_pads(weights.shape[2:], strides) if same else [0, 0, 0, 0]
    output = graph.add("Conv", *inputs, strides=strides, pads=pads, group=groups)
    if "Relu6" in fused:
        limits = [graph.constant(np.array(limit, np.float32)) for limit in (0, 6)]
        return graph.add("Clip", output, *limits)
    return graph.add("Relu", output) if "Relu" in fused else output


def same_pads(kernel: tuple[int, ...], strides: list[int]) -> list[int]:
    """TensorFlow's SAME padding for image sides that the stride divides; the odd row is last."""
    total = [size - stride for size, stride in zip(kernel, strides, strict=True)]
    before = [pixels // 2 for pixels in total]
    return before + [pixels - first for pixels, first in zip(total, before, strict=True)]


def resize(graph: Graph, node: Node) -> str:
    """Bilinear enlargement; the factors are in the node that multiplies the image's size."""
    if not node["attr"]["half_pixel_centers"]["b"] or node["attr"]["align_corners"]["b"]:
        raise SystemExit(f"{node['name']}: expected half-pixel centres")
    size = graph.source[node["input"][1]]
    factors = graph.weights[size["input"][1]]
    scales = graph.constant(np.array([1, 1, *factors], np.float32))
    image = graph.values[node["input"][0]]
    mode = "half_pixel"
    return graph.add(
        "Resize", image, "", scales, mode="linear", coordinate_transformation_mode=mode
    )


OPERATIONS: dict[str, Callable[[Graph, Node], str]] = {
    "Placeholder": placeholder,
    "Cast": cast,
    "Sub": elementwise("Sub"),
    "Mul": elementwise("Mul"),
    "AddV2": elementwise("Add"),
    "Sigmoid": elementwise("Sigmoid"),
    "_FusedConv2D": convolution,
    "DepthwiseConv2dNative": depthwise,
    "FusedDepthwiseConv2dNative": depthwise,
    "ResizeBilinear": resize,
}


def numbers(node: Node, attribute: str) -> list[int]:
    """Return an attribute that is a list of integers."""
    return [int(value) for value in node["attr"][attribute]["list"]["i"]]


def texts(node: Node, attribute: str) -> list[str]:
    """Return an attribute that is a list of texts; empty if the node has none."""
    values = node["attr"].get(attribute, {}).get("list", {}).get("s", [])
    return [base64.b64decode(value).decode() for value in values]
