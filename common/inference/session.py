"""Sessions of an inference library: arrays in, arrays out."""

from collections.abc import Mapping, Sequence
from typing import Literal, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from people4d.errors import ModelError
from people4d.messages import F64

Array = npt.NDArray[np.generic]
Engine: TypeAlias = Literal["onnxruntime", "openvino"]


class Session(Protocol):
    """A network that is ready to run."""

    @property
    def input_shape(self) -> tuple[int | None, ...]:
        """Lengths of the axes of the first input; None: any length."""
        ...

    @property
    def input_dtype(self) -> np.dtype[np.generic]:
        """Type of the first input's elements."""
        ...

    def run(self, image: Array) -> Mapping[str, Array]:
        """Run the network on its one input and return the outputs by name."""
        ...


def check_input(session: Session, shape: Sequence[int | None], network: str) -> None:
    """Check the lengths of the axes of a network's input; ModelError names the network."""
    if session.input_shape != tuple(shape):
        found = list(session.input_shape)
        raise ModelError(f"{network}: expected an input of {list(shape)}, got {found}")


def first_output(session: Session, images: Array) -> F64:
    """Return the first output of a network."""
    return np.asarray(next(iter(session.run(images).values())), np.float64)
