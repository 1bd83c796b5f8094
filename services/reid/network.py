"""Base of the networks that embed crops of people."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np

from common.inference.engines import open_session
from common.inference.session import Session
from common.io import weights
from common.transport.trace import span
from people4d.errors import ModelError
from people4d.messages import F32, Crop
from services.reid.config import ReidConfig


class NetworkEmbedder(ABC):
    """A network of the layout NxCxHxW to NxD, whose vectors are scaled to unit length.

    Args:
        session: The network; N is any or 1.
        name: Name of the network if it is not the default; only vectors of one name are comparable.

    Raises:
        ModelError: The network has another input or output.
    """

    usual_name: ClassVar[str]
    channels: ClassVar[int]  # C
    default_size: ClassVar[tuple[int, int] | None] = None  # H, W if the network leaves them open

    def __init__(self, session: Session, name: str = "") -> None:
        self.name = name or self.usual_name
        self._session = session
        shape, (height, width) = session.input_shape, self.default_size or (0, 0)
        if len(shape) == 4:
            height, width = shape[2] or height, shape[3] or width
        if len(shape) != 4 or shape[1] != self.channels or shape[0] not in (1, None) or not height:
            expected = f"an input of Nx{self.channels}xHxW, got {list(shape)}"
            raise ModelError(f"model {self.name}: expected {expected}")
        self.size = (height, width)
        self._batch = shape[0]
        output = self._run(np.zeros((1, self.channels, *self.size), np.float32))
        if output.ndim != 2:
            found = list(output.shape)
            raise ModelError(f"model {self.name}: expected an output of NxD, got {found}")
        self.dimension = output.shape[1]

    @classmethod
    def load(cls, config: ReidConfig) -> Self:
        """Find, check and load the configured network.

        Args:
            config: `model` is a name of the manifest or the path of an .onnx file.

        Raises:
            ModelError: The file is absent, altered or not such a network.
        """
        path, _ = weights.locate(config.network, config.folder)
        return cls(open_session(path, config.threads, config.engine))

    @abstractmethod
    def draw(self, crop: Crop, tensor: F32) -> None:
        """Write a crop as the network's input, CxHxW; its aspect ratio is not preserved."""

    def embed(self, crops: Sequence[Crop]) -> F32:
        """Embed crops (to NxD) in one run, or one by one if the network's N is 1."""
        if not crops:
            return np.zeros((0, self.dimension), np.float32)
        with span("preprocess"):
            images = np.empty((len(crops), self.channels, *self.size), np.float32)
            for crop, image in zip(crops, images, strict=True):
                self.draw(crop, image)
        parts = [images] if self._batch is None else list(images[:, None])
        vectors = np.concatenate([self._run(part) for part in parts])
        with span("postprocess"):
            norms = np.linalg.norm(vectors, axis=1, keepdims=True)
            return np.asarray(vectors / np.maximum(norms, 1e-12), np.float32)

    def _run(self, images: F32) -> F32:
        output = next(iter(self._session.run(images).values()))
        return np.asarray(output, np.float32)
