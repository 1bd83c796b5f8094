"""A network with constant outputs."""

from collections.abc import Mapping

import numpy as np

from common.inference.session import Array


class ArraySession:
    """Returns constant outputs, and stores the last image."""

    def __init__(
        self,
        outputs: Mapping[str, Array],
        input_shape: tuple[int | None, ...],
        dtype: str = "float32",
    ) -> None:
        self.outputs = dict(outputs)
        self.input_shape = input_shape
        self.input_dtype: np.dtype[np.generic] = np.dtype(dtype)
        self.image: Array = np.zeros(0)

    def run(self, image: Array) -> Mapping[str, Array]:
        self.image = image
        return self.outputs
