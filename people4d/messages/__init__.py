"""The messages on the wire: frozen, typed, checked when made and when decoded."""

from people4d.messages.base import F32, F64, U8, U16, Message, Span
from people4d.messages.camera import (
    CameraInfo,
    CompressedRgbdFrame,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
)
from people4d.messages.gait import BodyPoint, Gait, GaitMeasures, PersonGait
from people4d.messages.people import (
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
from people4d.messages.score import Alignment, PersonScore, Score, Tally
from people4d.messages.status import Health

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
