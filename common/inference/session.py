"""Sessions of an inference library: arrays in, arrays out."""

from collections.abc import Mapping
from typing import Literal, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

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
