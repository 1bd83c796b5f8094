"""Accuracy control: layers return to float32, most harmful first, until a network is accepted."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.inference.engines import correlation
from common.inference.onnx import OnnxSession
from common.inference.session import Array, Session
from evaluation.quantization.accuracy import AccuracyLoss
from evaluation.quantization.quantizer import Quantizer

GROWTH = 1.5  # ratio of the numbers of float32 layers of successive candidates


@dataclass(frozen=True)
class QuantizedCandidate:
    """A network with some layers in float32, and its losses."""

    floats: Sequence[str]  # convolutions in float32 in addition to the ends
    loss: AccuracyLoss


def harm(
    quantizer: Quantizer,
    reference: Session,
    images: Sequence[Array],
    path: Path,
    progress: Callable[[int, int], object] = lambda *_: None,
) -> dict[str, float]:
    """Return the change of the outputs by each convolution's quantisation, largest first.

    Each convolution in turn stays in float32 while all others are quantised. The change is the gain
    in correlation with the float32 network, mean over outputs and images.

    Args:
        quantizer: Quantiser of the network.
        reference: The same network in float32.
        images: Inputs of the network.
        path: File of the candidates, overwritten.
        progress: Called with the numbers of finished layers and of all layers.
    """
    expected = [reference.run(image) for image in images]
    ends = set(quantizer.ends())
    layers = [name for name in quantizer.convolutions if name not in ends]

    def change(floats: Collection[str]) -> float:
        quantizer.write(path, floats)
        session = OnnxSession(path)
        pairs = zip(expected, map(session.run, images), strict=True)
        return float(np.mean([_difference(one, other) for one, other in pairs]))

    everything = change(ends)
    found = {}
    for number, name in enumerate(layers, 1):
        found[name] = everything - change(ends | {name})
        progress(number, len(layers))
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def candidates(
    quantizer: Quantizer,
    path: Path,
    score: Callable[[Path], AccuracyLoss],
    order: Callable[[], Sequence[str]],
) -> Iterator[QuantizedCandidate]:
    """Yield networks with more and more layers in float32 until one is accepted.

    The file contains the last one.

    Args:
        quantizer: Quantiser of the network.
        path: File of the quantised network.
        score: Returns the losses of the network in a file.
        order: Returns the convolutions in the order in which they return to float32; called only
            if the first candidate is not accepted.
    """
    ends, layers, count = quantizer.ends(), list[str](), 0
    while True:
        floats = layers[:count]
        quantizer.write(path, [*ends, *floats])
        loss = score(path)
        yield QuantizedCandidate(floats, loss)
        if not count:
            layers = [] if loss.acceptable else list(order())
        if loss.acceptable or count >= len(layers):
            return
        count = min(max(count + 1, int(count * GROWTH)), len(layers))


def _difference(one: Mapping[str, Array], other: Mapping[str, Array]) -> float:
    correlations = [correlation(one[name], other[name]) for name in one]
    return 1.0 - float(np.mean(correlations))
