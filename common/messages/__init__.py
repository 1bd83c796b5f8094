"""The messages on the wire: frozen, typed, checked when made and when decoded."""

from common.messages.base import F32, F64, U8, U16, Message, Span
from common.messages.camera import (
    CameraInfo,
    CompressedRgbdFrame,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
)
from common.messages.gait import BodyPoint, Gait, GaitMeasures, PersonGait
from common.messages.people import (
    Crop,
    Crops,
    Detection,
    Detections,
    Embeddings,
    ImageTrack,
    ImageTracks,
    Mask,
    Track,
    Tracks,
    Truth,
    TruthPerson,
)
from common.messages.score import Alignment, PersonScore, Score, Tally
from common.messages.status import Health

__all__ = [
    "F32",
    "F64",
    "U8",
    "U16",
    "Alignment",
    "BodyPoint",
    "CameraInfo",
    "CompressedRgbdFrame",
    "Crop",
    "Crops",
    "Detection",
    "Detections",
    "Embeddings",
    "Gait",
    "GaitMeasures",
    "Health",
    "ImageTrack",
    "ImageTracks",
    "Mask",
    "Message",
    "MovingTransform",
    "Odometry",
    "PersonGait",
    "PersonScore",
    "RgbdFrame",
    "Score",
    "Span",
    "StaticTransform",
    "Tally",
    "Track",
    "Tracks",
    "Truth",
    "TruthPerson",
]
