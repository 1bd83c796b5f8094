"""Static quantisation of a network: 8-bit weights per channel, 8-bit activations."""

import logging
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from common.extras import need
from common.inference.session import Array
from people4d.errors import ConfigError, ModelError

QUANTIZED_OPS = ("Conv", "Add", "Resize", "Relu", "Clip", "MaxPool", "Concat", "Mul", "Sigmoid")
BATCH = 4  # number of images with all intermediate results in memory


class Quantizer:
    """A network, and the ranges (minimum and maximum) of its activations on given images.

    ConfigError if there are no images, or the package onnx is not installed; ModelError if the file
    is no network with convolutions.
    """

    def __init__(self, path: Path, images: Sequence[Array], folder: Path) -> None:
        if not images:
            raise ConfigError("there are no images to calibrate with")
        need("quantisation", "quantize")
        import onnx  # noqa: PLC0415  # an extra
        from onnxruntime.quantization import shape_inference  # noqa: PLC0415

        prepared = folder / "prepared.onnx"
        try:
            shape_inference.quant_pre_process(str(path), str(prepared), skip_symbolic_shape=True)
            self._graph: Any = onnx.load(str(prepared)).graph
            self.convolutions = [node.name for node in self._graph.node if node.op_type == "Conv"]
            if not self.convolutions:
                raise ValueError("it has no convolution")
            self._prepared = prepared
            self._ranges = self._calibrate(images)
        except Exception as error:  # onnx and onnxruntime raise their own types
            reason = (str(error).splitlines() or [""])[0][:200]
            raise ModelError(f"model file {path} cannot be quantised: {reason}") from error

    def ends(self) -> list[str]:
        """Return the convolutions at the ends of the network, which stay in float32."""
        return [name for name in self.convolutions if name in self._ends]

    @cached_property
    def _ends(self) -> frozenset[str]:
        """Operators up to the first convolution, and operators directly before an output.

        Int8 kernels are slower than float32 kernels for few channels, as at the input and the
        outputs. Eight bits cannot represent joined coordinates up to 640 px and scores up to 1.
        """
        nodes = list(self._graph.node)
        outputs = {output.name for output in self._graph.output}
        readers: dict[str, list[Any]] = {}
        for node in nodes:
            for name in node.input:
                readers.setdefault(name, []).append(node)
        first = next(index for index, node in enumerate(nodes) if node.op_type == "Conv")
        ends = {node.name for node in nodes[: first + 1]}
        last: set[str] = set()  # results that reach an output without another convolution
        for node in reversed(nodes):  # in reverse order of the computation
            following = readers.get(node.output[0], [])
            makes = any(n.op_type != "Conv" and n.output[0] in last for n in following)
            if makes or outputs.intersection(node.output):
                last.add(node.output[0])
                ends.add(node.name)
                if node.op_type == "Conv":
                    ends.update(self._chain(node, readers))
        return frozenset(ends)

    def _chain(self, head: Any, readers: Mapping[str, Sequence[Any]]) -> list[str]:
        """Return the operators between a head and the last branch or join before it.

        Empty if there is no branch or join: the chain is the whole network.
        """
        makers = {name: node for node in self._graph.node for name in node.output}
        outputs = {output.name for output in self._graph.output}
        chain, node = list[str](), head
        while inputs := [makers[name] for name in node.input if name in makers]:
            node, result = inputs[0], inputs[0].output[0]
            if len(inputs) > 1 or len(readers[result]) > 1 or result in outputs:
                return chain
            chain.append(node.name)
        return []

    def write(self, path: Path, floats: Collection[str]) -> None:
        """Write the quantised network; its ends, and `floats`, stay in float32."""
        import onnx  # noqa: PLC0415
        from onnxruntime.quantization import QuantType  # noqa: PLC0415
        from onnxruntime.quantization.qdq_quantizer import QDQQuantizer  # noqa: PLC0415

        quantizer = QDQQuantizer(
            onnx.load(str(self._prepared)),
            True,  # per channel
            False,
            QuantType.QInt8,
            QuantType.QUInt8,
            self._ranges,
            [],
            sorted(self._ends.union(floats)),
            list(QUANTIZED_OPS),
            {"ActivationSymmetric": False, "WeightSymmetric": True},
        )
        logging.getLogger().disabled = True
        try:
            quantizer.quantize_model()
        finally:
            logging.getLogger().disabled = False
        onnx.save(quantizer.model.model, str(path))

    def _calibrate(self, images: Sequence[Array]) -> Any:
        from onnxruntime.quantization import CalibrationMethod, create_calibrator  # noqa: PLC0415

        calibrator = create_calibrator(
            self._prepared,
            list(QUANTIZED_OPS),
            augmented_model_path=str(self._prepared.with_name("augmented.onnx")),
            calibrate_method=CalibrationMethod.MinMax,
        )
        name = self._graph.input[0].name
        for begin in range(0, len(images), BATCH):
            calibrator.collect_data(_Reader(name, images[begin : begin + BATCH]))
        return calibrator.compute_data()


class _Reader:
    """Iterator over images, as required by onnxruntime."""

    def __init__(self, name: str, images: Sequence[Array]) -> None:
        self._images: Iterator[Array] = iter(images)
        self._name = name

    def get_next(self) -> dict[str, Array] | None:
        image = next(self._images, None)
        return None if image is None else {self._name: np.asarray(image)}

    def __iter__(self) -> "_Reader":
        return self

    def __next__(self) -> dict[str, Array]:
        image = self.get_next()
        if image is None:
            raise StopIteration
        return image
