"""Sessions of an inference library: arrays in, arrays out."""

import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt
import onnxruntime

from common.transport.trace import span
from people4d.errors import ModelError

Array = npt.NDArray[np.generic]


class Session(Protocol):
    """A network that is ready to run."""

    @property
    def input_shape(self) -> tuple[int | None, ...]:
        """Lengths of the first input's axes, None where any length goes."""
        ...

    @property
    def input_dtype(self) -> np.dtype[np.generic]:
        """Type of the first input's elements."""
        ...

    def run(self, image: Array) -> Mapping[str, Array]:
        """Run the network on its one input and return the outputs by name."""
        ...


class OnnxSession:
    """A network in ONNX format on the CPU; one run at a time.

    Args:
        path: The .onnx file.
        threads: Threads that one run may use; they do not spin while idle.

    Raises:
        ModelError: The file is absent or not a network that can be run.
    """

    def __init__(self, path: Path, threads: int = 1) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = 3
        if not path.is_file():
            raise ModelError(f"model file {path} does not exist", "See: people4d models.")
        try:
            self._session = onnxruntime.InferenceSession(
                str(path), options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # onnxruntime raises its own types, all of them Exception
            reason = str(error).splitlines()[0][:200]
            raise ModelError(f"model file {path} cannot be loaded: {reason}") from error
        self._input = self._session.get_inputs()[0]
        self._outputs = [output.name for output in self._session.get_outputs()]
        self._turn = threading.Lock()

    @property
    def input_shape(self) -> tuple[int | None, ...]:
        """Lengths of the first input's axes, None where any length goes."""
        return tuple(n if isinstance(n, int) else None for n in self._input.shape)

    @property
    def input_dtype(self) -> np.dtype[np.generic]:
        """Type of the first input's elements."""
        names = {"tensor(float)": "float32", "tensor(float16)": "float16", "tensor(uint8)": "uint8"}
        return np.dtype(names.get(self._input.type, "float32"))

    def run(self, image: Array) -> Mapping[str, Array]:
        """Run the network on its one input and return the outputs by name."""
        with span("inference_wait"):
            self._turn.acquire()
        try:
            with span("inference"):
                outputs = self._session.run(self._outputs, {self._input.name: image})
        finally:
            self._turn.release()
        return dict(zip(self._outputs, outputs, strict=True))
