"""OSNet: a small network trained to tell people apart by their appearance."""

from collections.abc import Sequence

import cv2
import numpy as np

from common.inference import OnnxSession, Session
from common.io import weights
from common.transport.trace import span
from people4d.errors import ModelError
from people4d.messages import F32, U8, Crop
from services.reid.config import ReidConfig

COSINE_DISTANCE_MAX = 0.45  # C_cos of docs/method.md section 5; benchmarks/reid_threshold.md
MEAN = np.array([0.485, 0.456, 0.406], np.float32)  # of ImageNet, red first, values 0 to 1
DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)
DEFAULT_SIZE = (256, 128)


def load(config: ReidConfig) -> "OsnetEmbedder":
    """Find, check and load the configured network.

    Args:
        config: `model` is a name of the manifest or the path of an .onnx file.

    Raises:
        ModelError: The file is absent, altered or not such a network.
    """
    path, _ = weights.locate(config.model, config.folder)
    return OsnetEmbedder(OnnxSession(path, config.threads))


class OsnetEmbedder:
    """OSNet in torchreid's ONNX layout: Nx3x256x128, ImageNet mean and deviation, to NxD.

    Args:
        session: The network.
        name: Name of the network; only vectors of one name compare.

    Raises:
        ModelError: The network takes or gives something else.
    """

    def __init__(self, session: Session, name: str = "osnet") -> None:
        self.name = name
        self._session = session
        shape = session.input_shape
        if len(shape) != 4 or shape[1] != 3 or shape[0] not in (1, None):
            raise ModelError(f"model {name}: expected an input of Nx3xHxW, got {list(shape)}")
        self._size = (shape[2] or DEFAULT_SIZE[0], shape[3] or DEFAULT_SIZE[1])
        self._batch = shape[0]
        output = self._run(np.zeros((1, 3, *self._size), np.float32))
        if output.ndim != 2:
            raise ModelError(f"model {name}: expected an output of NxD, got {list(output.shape)}")
        self.dimension = output.shape[1]

    def embed(self, crops: Sequence[Crop]) -> F32:
        """Embed crops in one run, or one by one if the network is made for one."""
        if not crops:
            return np.zeros((0, self.dimension), np.float32)
        with span("preprocess"):
            images = np.stack([_tensor(crop.rgb, self._size) for crop in crops])
        parts = [images] if self._batch is None else list(images[:, None])
        vectors = np.concatenate([self._run(part) for part in parts])
        with span("postprocess"):
            norms = np.linalg.norm(vectors, axis=1, keepdims=True)
            return np.asarray(vectors / np.maximum(norms, 1e-12), np.float32)

    def _run(self, images: F32) -> F32:
        output = next(iter(self._session.run(images).values()))
        return np.asarray(output, np.float32)


def _tensor(rgb: U8, size: tuple[int, int]) -> F32:
    """Return an image as the network takes it, 3xHxW; the shape of the box is not kept."""
    height, width = size
    shrinks = rgb.shape[0] > height and rgb.shape[1] > width
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    resized = cv2.resize(rgb, (width, height), interpolation=method)
    values = (np.asarray(resized, np.float32) / 255 - MEAN) / DEVIATION
    return np.ascontiguousarray(values.transpose(2, 0, 1))
