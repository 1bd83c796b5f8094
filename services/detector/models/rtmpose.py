"""RTMPose [Jiang 2023]: 17 keypoints of one person in a box of another people model.

The network gives, for each keypoint, scores of the bins of its x and of its y (SimCC). Networks of
more keypoints (Halpe 26, COCO-WholeBody 133) have COCO's 17 first; the others are ignored.
"""

from dataclasses import replace

import cv2
import msgspec
import numpy as np

from common.inference.session import Array, Session
from common.transport.trace import span
from people4d.errors import ModelError
from people4d.messages import F32, F64, U8
from services.detector.config import ModelSettings, shipped_model
from services.detector.models.base import DetectedPerson
from services.detector.models.network import ImageInput, Outputs
from services.detector.models.registry import load_boxes

DEFAULT_SIZE = (256, 192)
PADDING = 1.25  # side of the crop relative to the box, as in the network's training
BINS_PER_PIXEL = 2
# Mean and standard deviation of the colours (RGB) in the network's training
MEAN = np.array([123.675, 116.28, 103.53], np.float32)
DEVIATION = np.array([58.395, 57.12, 57.375], np.float32)


class RtmPose:
    """Boxes of the model `settings.boxes` (the shipped one if empty), keypoints by RTMPose.

    Args:
        session: Session of RTMPose.
        settings: Settings of the box model; its scores are published.
        name: Name of the model, for results; empty: its kind.

    Raises:
        ModelError: The network is of another kind, or the box model cannot be loaded.
    """

    kind = "rtmpose"

    def __init__(self, session: Session, settings: ModelSettings, name: str = "") -> None:
        self.name = name or self.kind
        self._session = session
        one = ModelSettings()  # settings of size are for the box model
        self._input = ImageInput.from_session(session, one, DEFAULT_SIZE)
        if session.input_dtype != np.float32 or not self._input.channels_first:
            raise ModelError(f"{self.name}: expected an input of float32, 1x3xHxW")
        self._outputs = self._check(self._input.try_out(session, self.name))
        boxes = settings.boxes or shipped_model()
        self._boxes = load_boxes(msgspec.structs.replace(settings, model=boxes, kind="", boxes=""))

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        """Find people in an HxWx3 colour image, best score first."""
        return [self._with_keypoints(person, rgb) for person in self._boxes.detect(rgb)]

    def _check(self, outputs: Outputs) -> tuple[str, str]:
        """Return the names of the scores of x and y."""
        bins = [BINS_PER_PIXEL * side for side in (self._input.width, self._input.height)]
        shapes = [array.shape for array in outputs.values()]
        if [(len(shape), shape[-1]) for shape in shapes] != [(3, side) for side in bins] or any(
            shape[1] < 17 for shape in shapes
        ):
            got = ", ".join(f"{name} {array.shape}" for name, array in outputs.items())
            expected = " and ".join(f"1x17x{side}" for side in bins)
            raise ModelError(f"{self.name}: expected outputs {expected}, got {got}")
        x, y = outputs
        return x, y

    def _with_keypoints(self, person: DetectedPerson, rgb: U8) -> DetectedPerson:
        with span("preprocess"):
            image, corner, scale = crop(rgb, person.box_xyxy_px, self._input.size)
        outputs = self._session.run(image)
        with span("postprocess"):
            x, y = (outputs[name][0, :17].astype(np.float32) for name in self._outputs)
            return replace(person, keypoints=keypoints_of(x, y, corner, scale))


def crop(rgb: U8, box: F32, size: tuple[int, int]) -> tuple[Array, F64, float]:
    """Return the network's input around a box, its corner in the image [px] and its scale.

    Positions are continuous, as in `Letterbox`. The centre of the input's first pixel is at the
    corner, as in the network's training; outside of the image the crop is black.

    Args:
        rgb: HxWx3, the image.
        box: left, top, right, bottom [px].
        size: Height and width of the input [px].

    Returns:
        Input 1x3xHxW; position of its corner (x, y); pixels of the image per pixel of the input.
    """
    height, width = size
    sides = np.maximum(box[2:] - box[:2], 1.0).astype(np.float64) * PADDING
    scale = float(max(sides / (width, height)))
    corner = (box[:2] + box[2:]).astype(np.float64) / 2 - scale / 2 * np.array([width, height])
    mapping = np.column_stack([scale * np.eye(2), corner - 0.5])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    image = cv2.warpAffine(rgb, mapping, (width, height), flags=flags)
    normal = (image - MEAN) / DEVIATION
    return np.ascontiguousarray(normal.transpose(2, 0, 1))[None], corner, scale


def keypoints_of(x: F32, y: F32, corner: F64, scale: float) -> F32:
    """Return 17x3 (u, v, confidence) at the best bins (17xB) of a crop.

    The confidence is the mean of both best scores, limited to 0 to 1.
    """
    best = np.stack([x.argmax(axis=1), y.argmax(axis=1)], axis=1)
    confidence = np.clip((x.max(axis=1) + y.max(axis=1)) / 2, 0.0, 1.0)
    positions = corner + best * (scale / BINS_PER_PIXEL)
    return np.column_stack([positions, confidence]).astype(np.float32)
