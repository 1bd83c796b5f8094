"""Accuracy control: layers go back to float, the most harmful first, until a network holds."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.inference.engines import correlation
from common.inference.onnx import OnnxSession
from common.inference.session import Array, Session
from evaluation.quantization.accuracy import AccuracyLoss
from evaluation.quantization.quantizer import Quantizer

GROWTH = 1.5  # layers in float, from one candidate to the next


@dataclass(frozen=True)
class QuantizedCandidate:
    """A network with some layers in float, and what it loses."""

    floats: Sequence[str]  # convolutions that stay in float, beside the ends
    loss: AccuracyLoss


def harm(
    quantizer: Quantizer,
    reference: Session,
    images: Sequence[Array],
    path: Path,
    progress: Callable[[int, int], object] = lambda *_: None,
) -> dict[str, float]:
    """Return by how much each convolution's quantisation changes the outputs, largest first.

    Each in turn stays in float while all others are quantised; the change is that of one minus the
    correlation with the network in float, mean over outputs and images.

    Args:
        quantizer: The network.
        reference: The same, in float.
        images: Arrays as the network takes them.
        path: File that is written over and over.
        progress: Is called with the number of layers done, and of all.
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
    """Yield networks with ever more layers in float, until one holds; the file is the last one.

    Args:
        quantizer: The network.
        path: File of the quantised network.
        score: Returns what the network in a file loses.
        order: Returns the convolutions in the order in which they go back to float; asked only if
            the network does not hold without it.
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
