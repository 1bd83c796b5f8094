"""Inference engines: sessions of networks, and a check of int8 networks."""

import logging
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from common.inference.cores import InferenceCores
from common.inference.onnx import OnnxSession
from common.inference.processor import has_integer_dot_products
from common.inference.session import Array, Engine, Session

PROBE_SIDES = (256, 320)  # height and width of the probe image for a network of any size [px]
# Minimum mean correlation with the outputs of the unoptimised graph. Another order of operations
# gives 0.88 for MoveNet on this image, wrong fusion 0.5
CORRELATION_MIN = 0.75

log = logging.getLogger("people4d")


def open_session(
    path: Path,
    threads: int = 1,
    engine: Engine = "onnxruntime",
    cores: InferenceCores | None = None,
) -> Session:
    """Open a network with an engine.

    The outputs of an int8 network are compared with its unoptimised graph on one image. If they
    differ, the unoptimised graph is used, which is slower. Some versions of the libraries fuse such
    graphs wrongly or cannot run the fused graph. On processors without 8-bit dot products sums
    saturate: the correlation on images of people falls from .998 to .96.

    Args:
        path: The .onnx file.
        threads: Maximum number of threads of one run.
        engine: Name of the engine.
        cores: Cores of the network's thread; None: run in the threads of the callers.

    Raises:
        ModelError: The file is absent or cannot be run, or the engine is not installed.
    """
    session: Session
    if engine == "openvino":
        from common.inference.openvino import OpenVinoSession  # noqa: PLC0415  # an extra

        session = OpenVinoSession(path, threads, cores)
    else:
        session = OnnxSession(path, threads, cores=cores)
    if not is_quantized(path):
        return session
    reference = OnnxSession(path, threads, optimised=False, cores=cores)
    image = probe_image(session)
    expected = reference.run(image)
    try:
        found = mean_correlation(expected, session.run(image))
    except Exception as error:  # the libraries raise their own types
        problem = f"cannot run it fused: {(str(error).splitlines() or [''])[0][:200]}"
    else:
        if found >= CORRELATION_MIN:
            return session
        problem = (
            "computes another result than the file says "
            f"(correlation {found:.3f}, expected {CORRELATION_MIN:.2f})"
        )
    remedy = "" if has_integer_dot_products() else ", slowly: use a float network on this processor"
    log.warning("%s: %s %s; it runs without optimisation%s", path.name, engine, problem, remedy)
    return reference


def is_quantized(path: Path) -> bool:
    """Check for an int8 network."""
    return b"QuantizeLinear" in path.read_bytes()


def mean_correlation(expected: Mapping[str, Array], got: Mapping[str, Array]) -> float:
    """Return the mean correlation of the outputs of two runs of one network on one image."""
    return float(np.mean([correlation(got[name], array) for name, array in expected.items()]))


def probe_image(session: Session, sides: tuple[int, int] = PROBE_SIDES) -> Array:
    """Return an image of noise as input of a network: bytes to 255, floats to 1.

    Args:
        session: Session of the network.
        sides: Height and width for a network of any size [px].
    """
    free = iter(sides)
    shape = [
        axis or (1 if index == 0 else next(free)) for index, axis in enumerate(session.input_shape)
    ]
    image = np.random.default_rng(0).random(shape)
    if session.input_dtype == np.uint8:
        image *= 255
    return image.astype(session.input_dtype)


def correlation(one: Array, other: Array) -> float:
    """Return the correlation of the values of two arrays; 1 for equal constant arrays."""
    a, b = (np.asarray(x, np.float64).ravel() for x in (one, other))
    a, b = a - a.mean(), b - b.mean()
    spread = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / spread if spread else float(np.allclose(one, other))
