"""Heads of MoveNet: maps of the whole image, and values at the cells of people.

Four of the six heads are needed at a few cells only. The shipped file outputs their weights and
input features, and these heads are computed at those cells only, with the same values. Files with
all heads are supported, too.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from common.inference.session import Array
from people4d.messages import F32
from services.detector.models.network import Outputs, check_output

MAPS = {"center": 1, "kpt_heatmap": 17}  # number of channels by head
LOCAL = {"box_scale": 2, "box_offset": 2, "kpt_regress": 34, "kpt_offset": 34}
# Offsets of a 3x3 kernel
REACH = np.array([(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1)])
FEATURES = 24

Cells: TypeAlias = npt.NDArray[np.intp]
Layer: TypeAlias = tuple[F32, F32]  # weights and bias of a matrix product


class Heads(Protocol):
    """Heads of one image, on a grid of HxW cells."""

    center: F32  # HxW, probability of a person's centre
    keypoints: F32  # 17xHxW, probabilities of keypoints

    def read(self, heads: Sequence[str], rows: Cells, columns: Cells) -> list[F32]:
        """Return the values of heads of `LOCAL` at N cells, NxC each."""
        ...


class DenseHeads:
    """Heads computed everywhere by the network: logits of the maps, and values."""

    def __init__(self, outputs: Outputs) -> None:
        self.center = sigmoid(outputs["center"][0, 0])
        self.keypoints = sigmoid(outputs["kpt_heatmap"][0])
        self._outputs = outputs

    def read(self, heads: Sequence[str], rows: Cells, columns: Cells) -> list[F32]:
        """Return the values of heads at N cells, NxC each."""
        maps = (self._outputs[head][0] for head in heads)
        return [np.asarray(values[:, rows, columns].T, np.float32) for values in maps]


class LocalHeads:
    """Heads computed only at the cells in use."""

    def __init__(self, outputs: Outputs, layers: Mapping[str, Sequence[Layer]]) -> None:
        self.center = np.asarray(outputs["center_map"][0, 0], np.float32)
        self.keypoints = np.asarray(outputs["kpt_map"][0], np.float32)
        self._features = np.asarray(outputs["features"][0], np.float32)
        self._layers = layers

    def read(self, heads: Sequence[str], rows: Cells, columns: Cells) -> list[F32]:
        """Return the values of heads at N cells, NxC each."""
        height, width = self.center.shape
        y, x = rows[:, None] + REACH[:, 0], columns[:, None] + REACH[:, 1]
        bounded = np.minimum(np.maximum(y, 0), height - 1), np.minimum(np.maximum(x, 0), width - 1)
        cells = bounded[0] * width + bounded[1]
        patches = self._features.reshape(FEATURES, -1).take(cells, axis=1)
        inside = (y == bounded[0]) & (x == bounded[1])
        if not inside.all():
            patches *= inside
        flat = patches.transpose(1, 0, 2).reshape(len(rows), FEATURES * len(REACH))
        return [_computed(flat, *self._layers[head]) for head in heads]


def _computed(values: F32, *layers: Layer) -> F32:
    """Return a matrix product of values, ReLU, and a second matrix product."""
    (weights, bias), (last_weights, last_bias) = layers
    computed: F32 = np.maximum(values @ weights + bias, 0) @ last_weights + last_bias
    return computed


class HeadReader:
    """Finds the heads in the outputs of a network.

    Args:
        outputs: Outputs of a first run.
        height: Height of the grid in cells.
        width: Width of the grid in cells.
        model: Name of the model, for errors.

    Raises:
        ModelError: An output is absent or of another shape.
    """

    def __init__(self, outputs: Outputs, height: int, width: int, model: str) -> None:
        self._layers: dict[str, Sequence[Layer]] = {}
        if "features" not in outputs:
            for head, channels in (MAPS | LOCAL).items():
                check_output(outputs, head, (1, channels, height, width), model)
            return
        for name, channels in (("center_map", 1), ("kpt_map", 17), ("features", FEATURES)):
            check_output(outputs, name, (1, channels, height, width), model)
        count = len(LOCAL)
        check_output(outputs, "local.depthwise", (count, len(REACH), FEATURES), model)
        check_output(outputs, "local.pointwise", (count, FEATURES, None), model)
        hidden = outputs["local.pointwise"].shape[2]
        check_output(outputs, "local.pointwise_bias", (count, hidden), model)
        check_output(outputs, "local.output", (sum(LOCAL.values()), hidden), model)
        check_output(outputs, "local.output_bias", (sum(LOCAL.values()),), model)
        self._layers = _local_layers(outputs)

    def heads(self, outputs: Outputs) -> Heads:
        """Return the heads of one run."""
        return LocalHeads(outputs, self._layers) if self._layers else DenseHeads(outputs)


def _local_layers(outputs: Outputs) -> dict[str, Sequence[Layer]]:
    """Return the layers of each local head: matrix product from 3x3 features, ReLU, second one.

    The first is the product of the depthwise and the pointwise convolution, which have no
    activation between them.
    """
    taps, mix, bias, last, last_bias = (
        np.asarray(outputs[f"local.{name}"], np.float32)
        for name in ("depthwise", "pointwise", "pointwise_bias", "output", "output_bias")
    )
    products = taps.transpose(0, 2, 1)[..., None] * mix[:, :, None]  # head, feature, tap, hidden
    first = products.reshape(len(LOCAL), -1, mix.shape[2])
    ends = np.cumsum(list(LOCAL.values()))[:-1]
    lasts = zip(np.split(last, ends), np.split(last_bias, ends), strict=True)
    return {
        head: ((first[k], bias[k]), (weights.T.copy(), values))
        for k, (head, (weights, values)) in enumerate(zip(LOCAL, lasts, strict=True))
    }


def sigmoid(logits: Array) -> F32:
    """Return 1 / (1 + exp(-x))."""
    return np.asarray(1 / (1 + np.exp(-logits.astype(np.float32))), np.float32)
