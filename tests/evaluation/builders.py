"""Small recordings of detections and truth."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL
from common.io.recording import RecordingWriter
from people4d.messages import Detection, Detections, Message, Truth, TruthPerson
from tests import builders

STEP_NS = 100_000_000  # 10 frames a second
INFO = builders.camera_info(cx=319.5, cy=239.5)


def detections(frame: int, *positions_m: Sequence[float]) -> Detections:
    """Detections of a frame at positions in the optical frame, each in a box of its own."""
    people = []
    for x, y, z in positions_m:
        u, v, half = 319.5 + 600 * x / z, 239.5 + 600 * y / z, 300 / z
        box = np.array([u - half / 2, v - half, u + half / 2, v + half], np.float32)
        position_m = np.array([x, y, z], np.float64)
        people.append(Detection(box_xyxy_px=box, score=0.9, position_m=position_m))
    return builders.detections(
        *people, stamp_ns=frame * STEP_NS, sequence=frame, frame_id=INFO.frame_id
    )


def truth(frame: int, **positions: tuple[float, float]) -> Truth:
    """Truth of standing people facing the camera, by x and y in the map."""
    people = tuple(
        TruthPerson(
            id=name, position_m=np.array([x, y, 0.0]), velocity_mps=np.zeros(3), yaw_rad=np.pi
        )
        for name, (x, y) in positions.items()
    )
    return builders.truth(*people, stamp_ns=frame * STEP_NS, sequence=frame)


def write(path: Path, messages: Sequence[Message], frame_id: str = "map") -> Path:
    """Write a recording of a camera at the origin of the map that looks along +x."""
    pose = builders.static_transform(LINK_FROM_OPTICAL, parent=frame_id, child=INFO.frame_id)
    with RecordingWriter(path) as writer:
        for message in (INFO, pose, *messages):
            writer.write(message, message.stamp_ns)
    return path
