"""Sessions of onnxruntime."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from common.inference.cores import InferenceCores, NetworkRuns
from common.inference.session import Array
from people4d.errors import ModelError

# This optimiser quantises float32 convolutions with one range for all channels: MoveNet with one
# such layer is useless (onnxruntime 1.31).
DISABLED = ["WeightBiasQuantization"]


class OnnxSession:
    """A network in ONNX format on the CPU; one run at a time.

    Args:
        path: The .onnx file.
        threads: Maximum number of threads of one run; idle threads do not spin.
        optimised: True: onnxruntime fuses operators.
        cores: See `NetworkRuns`.

    Raises:
        ModelError: The file is absent or not a network that can be run.
    """

    def __init__(
        self,
        path: Path,
        threads: int = 1,
        optimised: bool = True,
        cores: InferenceCores | None = None,
    ) -> None:
        import onnxruntime  # noqa: PLC0415  # it starts a thread, and many services never need it

        self.optimised = optimised
        self._runs = NetworkRuns(cores)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = 3
        if not optimised:
            level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
            options.graph_optimization_level = level
        if not path.is_file():
            raise ModelError(f"model file {path} does not exist", "See: people4d models.")
        try:
            self._session = self._runs.call(  # threads of the session inherit the cores
                lambda: onnxruntime.InferenceSession(
                    str(path),
                    options,
                    providers=["CPUExecutionProvider"],
                    disabled_optimizers=DISABLED,
                )
            )
        except Exception as error:  # onnxruntime raises its own types, all of them Exception
            reason = str(error).splitlines()[0][:200]
            raise ModelError(f"model file {path} cannot be loaded: {reason}") from error
        self._input = self._session.get_inputs()[0]
        self._outputs = [output.name for output in self._session.get_outputs()]

    @property
    def input_shape(self) -> tuple[int | None, ...]:
        """Lengths of the axes of the first input; None: any length."""
        return tuple(n if isinstance(n, int) else None for n in self._input.shape)

    @property
    def input_dtype(self) -> np.dtype[np.generic]:
        """Type of the first input's elements."""
        names = {"tensor(float)": "float32", "tensor(float16)": "float16", "tensor(uint8)": "uint8"}
        return np.dtype(names.get(self._input.type, "float32"))

    def run(self, image: Array) -> Mapping[str, Array]:
        """Run the network on its one input and return the outputs by name."""
        inputs = {self._input.name: image}
        outputs = self._runs.run(lambda: self._session.run(self._outputs, inputs))
        return dict(zip(self._outputs, outputs, strict=True))
