"""Sessions of OpenVINO, an engine for Intel processors; the extra openvino."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from common.extras import need
from common.inference.cores import InferenceCores, NetworkRuns
from common.inference.session import Array
from people4d.errors import ModelError

SHAPES_MAX = 8  # maximum number of image sizes with a compiled network


class OpenVinoSession:
    """A network in ONNX format on the CPU; one run at a time, compiled for each image size.

    Args:
        path: The .onnx file.
        threads: Maximum number of threads of one run, not pinned to cores.
        cores: See `NetworkRuns`.

    Raises:
        ConfigError: OpenVINO is not installed.
        ModelError: The file is absent or cannot be run.
    """

    def __init__(self, path: Path, threads: int = 1, cores: InferenceCores | None = None) -> None:
        need("the engine openvino", "openvino")
        import openvino  # noqa: PLC0415  # an extra

        if not path.is_file():
            raise ModelError(f"model file {path} does not exist", "See: people4d models.")
        self._core: Any = openvino.Core()
        self._settings = {
            "INFERENCE_NUM_THREADS": threads,
            "NUM_STREAMS": 1,
            "ENABLE_CPU_PINNING": False,
            "INFERENCE_PRECISION_HINT": "f32",  # no bfloat16 on processors that have it
        }
        self._path = path
        self._runs = NetworkRuns(cores)
        try:
            model = self._core.read_model(path)
            self._shape = tuple(
                axis.get_length() if axis.is_static else None
                for axis in model.inputs[0].partial_shape
            )
            self._dtype: np.dtype[np.generic] = np.dtype(model.inputs[0].element_type.to_dtype())
        except Exception as error:  # OpenVINO raises RuntimeError and its own types
            raise self._error(error) from error
        self._names = [min(output.get_names(), key=len) for output in model.outputs]
        self._requests: dict[tuple[int, ...], Any] = {}

    @property
    def input_shape(self) -> tuple[int | None, ...]:
        """Lengths of the axes of the first input; None: any length."""
        return self._shape

    @property
    def input_dtype(self) -> np.dtype[np.generic]:
        """Type of the first input's elements."""
        return self._dtype

    def run(self, image: Array) -> Mapping[str, Array]:
        """Run the network on its one input and return the outputs by name."""
        return self._runs.run(lambda: self._infer(image))

    def _infer(self, image: Array) -> Mapping[str, Array]:
        """Return the outputs by name."""
        request = self._request(image.shape)
        request.infer({0: image}, share_inputs=True)
        outputs = [request.get_output_tensor(k).data for k in range(len(self._names))]
        return dict(zip(self._names, map(np.copy, outputs), strict=True))

    def _request(self, shape: tuple[int, ...]) -> Any:
        """Return the inference request of an image shape; batches of any size share one."""
        wanted = tuple(
            -1 if axis is None and index == 0 else length
            for index, (axis, length) in enumerate(zip(self._shape, shape, strict=True))
        )
        if wanted not in self._requests:
            if len(self._requests) >= SHAPES_MAX:
                self._requests.pop(next(iter(self._requests)))
            model = self._core.read_model(self._path)
            model.reshape(list(wanted))
            try:
                compiled = self._core.compile_model(model, "CPU", self._settings)
            except Exception as error:
                raise self._error(error) from error
            self._requests[wanted] = compiled.create_infer_request()
        return self._requests[wanted]

    def _error(self, error: Exception) -> ModelError:
        reason = (str(error).splitlines() or [""])[-1][:200]
        return ModelError(f"model file {self._path} cannot be loaded: {reason}")
