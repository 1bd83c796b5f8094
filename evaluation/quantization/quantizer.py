"""Static quantisation of a network: 8-bit weights per channel, 8-bit activations."""

import logging
from collections.abc import Collection, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from common.inference.session import Array
from people4d.errors import ConfigError, ModelError

QUANTIZED_OPS = ("Conv", "Add", "Resize", "Relu", "Clip", "MaxPool", "Concat", "Mul", "Sigmoid")
BATCH = 4  # images of which all intermediate results are in memory at once


class Quantizer:
    """A network, and the ranges of its activations on given images, from least to greatest value.

    Ranges of 99.99 and 99.999 % of the values gave no better accuracy (docs/methods/models.md).

    Args:
        path: The .onnx file.
        images: Arrays as the network takes them, each of a batch of one.
        folder: Folder for files of its own.

    Raises:
        ConfigError: There are no images, or the package onnx is not installed.
        ModelError: The file is no network with convolutions that can be quantised.
    """

    def __init__(self, path: Path, images: Sequence[Array], folder: Path) -> None:
        if not images:
            raise ConfigError("there are no images to calibrate with")
        try:
            import onnx  # noqa: PLC0415  # an extra
            from onnxruntime.quantization import shape_inference  # noqa: PLC0415
        except ImportError:
            raise ConfigError(
                "quantisation needs the package onnx", "Install it: pip install people4d[quantize]."
            ) from None
        prepared = folder / "prepared.onnx"
        try:
            shape_inference.quant_pre_process(str(path), str(prepared), skip_symbolic_shape=True)
            self._graph: Any = onnx.load(str(prepared)).graph
            self.convolutions = [node.name for node in self._graph.node if node.op_type == "Conv"]
            if not self.convolutions:
                raise ValueError("it has no convolution")
            self._prepared = prepared
            self._ranges = self._calibrate(images)
        except Exception as error:  # onnx and onnxruntime raise types of their own
            reason = (str(error).splitlines() or [""])[0][:200]
            raise ModelError(f"model file {path} cannot be quantised: {reason}") from error

    def heads(self) -> list[str]:
        """Return the convolutions that no other one follows: they make the outputs."""
        return [name for name in self.convolutions if name in self._ends]

    @cached_property
    def _ends(self) -> frozenset[str]:
        """Operators that no convolution follows: the heads, and what decodes their results.

        Eight bits cannot hold coordinates up to 640 px and scores up to 1 that are joined there.
        """
        readers: dict[str, list[Any]] = {}
        for node in self._graph.node:
            for name in node.input:
                readers.setdefault(name, []).append(node)
        leads_on: dict[str, bool] = {}  # whether a convolution reads a node's results, or others do
        for node in reversed(self._graph.node):  # against the order of the computation
            following = [reader for name in node.output for reader in readers.get(name, [])]
            leads_on[node.name] = any(n.op_type == "Conv" or leads_on[n.name] for n in following)
        return frozenset(name for name, leads in leads_on.items() if not leads)

    def write(self, path: Path, floats: Collection[str]) -> None:
        """Write the quantised network; `floats` names convolutions that stay as they are.

        What follows the heads stays in float, too.
        """
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
    """Images one by one, as onnxruntime asks for them."""

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
