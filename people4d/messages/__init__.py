"""The messages on the wire: frozen, typed, checked when made and when decoded."""

from people4d.messages.areas import AreaPeople, AreaPerson
from people4d.messages.base import F32, F64, U8, U16, Message, Span
from people4d.messages.camera import (
    CameraInfo,
    CompressedRgbdFrame,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
)
from people4d.messages.events import Event, Zone, ZoneEdit, Zones
from people4d.messages.gait import BodyPoint, Gait, GaitMeasures, PersonGait
from people4d.messages.people import (
    HIDDEN_RGB,
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
from people4d.messages.prediction import (
    MotionProbabilities,
    PersonPrediction,
    Predictions,
    RobotEncounter,
)
from people4d.messages.score import Alignment, PersonScore, Score, Tally
from people4d.messages.skeleton import JOINTS, PersonSkeleton, Skeletons
from people4d.messages.status import Health
from people4d.messages.target import Target, TargetCommand

__all__ = [
    "F32",
    "F64",
    "HIDDEN_RGB",
    "JOINTS",
    "U8",
    "U16",
    "Alignment",
    "AreaPeople",
    "AreaPerson",
    "BodyPoint",
    "CameraInfo",
    "CompressedRgbdFrame",
    "Crop",
    "Crops",
    "Detection",
    "Detections",
    "Embeddings",
    "Event",
    "Gait",
    "GaitMeasures",
    "Health",
    "ImageTrack",
    "ImageTracks",
    "Mask",
    "Message",
    "MotionProbabilities",
    "MovingTransform",
    "Odometry",
    "PersonGait",
    "PersonPrediction",
    "PersonScore",
    "PersonSkeleton",
    "Predictions",
    "RgbdFrame",
    "RobotEncounter",
    "Score",
    "Skeletons",
    "Span",
    "StaticTransform",
    "Tally",
    "Target",
    "TargetCommand",
    "Track",
    "Tracks",
    "Truth",
    "TruthPerson",
    "Zone",
    "ZoneEdit",
    "Zones",
]
