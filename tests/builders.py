"""Messages and their parts for tests, with plain defaults."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from people4d.messages import (
    CameraInfo,
    Detection,
    Detections,
    Embeddings,
    Health,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
    Track,
    Tracks,
    Truth,
    TruthPerson,
)

HEADER: dict[str, Any] = {"stamp_ns": 0, "sequence": 0}
OPTICAL = "front_optical_frame"


def camera_info(**fields: Any) -> CameraInfo:
    """Build a camera "front" of 640x480; fy as fx (600 px), principal point in the middle."""
    fields = {"camera": "front", "frame_id": OPTICAL, "width": 640, "height": 480, **fields}
    fields = {"fx": 600.0, "cx": fields["width"] / 2, "cy": fields["height"] / 2, **fields}
    return CameraInfo(**{**HEADER, "fy": fields["fx"], **fields})


def rgbd_frame(**fields: Any) -> RgbdFrame:
    """Build a frame of camera "front"; `rgb` and `depth_mm` have to be given."""
    return RgbdFrame(**{**HEADER, "camera": "front", **fields})


def static_transform(
    matrix: npt.ArrayLike, child: str = OPTICAL, parent: str = "map", **fields: Any
) -> StaticTransform:
    """Build the transform of a frame, by default of the camera in the map."""
    fields = {**HEADER, **fields}
    return StaticTransform(parent=parent, child=child, matrix=np.asarray(matrix), **fields)


def moving_transform(
    matrix: npt.ArrayLike, child: str = "head", parent: str = "base_link", **fields: Any
) -> MovingTransform:
    """Build the transform of a moving frame, by default of the head on the base."""
    fields = {**HEADER, **fields}
    return MovingTransform(parent=parent, child=child, matrix=np.asarray(matrix), **fields)


def odometry(**fields: Any) -> Odometry:
    """Build odometry of "base_link" in "odom", at the origin."""
    frames = {"frame_id": "odom", "child_frame_id": "base_link"}
    return Odometry(**{**HEADER, **frames, "x_m": 0.0, "y_m": 0.0, "theta_rad": 0.0, **fields})


def detection(**fields: Any) -> Detection:
    """Build a detection of score 0.9 with neither keypoints, mask nor position."""
    box_xyxy_px = np.array([100, 100, 200, 300], np.float32)
    return Detection(**{"box_xyxy_px": box_xyxy_px, "score": 0.9, **fields})


def detections(*people: Detection, **fields: Any) -> Detections:
    """Build the detections in a frame of 640x480 of camera "front"."""
    camera = {"camera": "front", "frame_id": OPTICAL, "width": 640, "height": 480}
    return Detections(**{**HEADER, **camera, "model": "test", "detections": people, **fields})


def embeddings(
    of: Detections, vectors: Sequence[Sequence[float]] = ((1.0, 0.0),), **fields: Any
) -> Embeddings:
    """Build the embeddings of the first detections of a frame, a vector each."""
    header = {"stamp_ns": of.stamp_ns, "sequence": of.sequence, "camera": of.camera}
    array = np.array(vectors, np.float32).reshape(-1, len(vectors[0]) if vectors else 2)
    rows = {"detections": tuple(range(len(vectors))), "vectors": array}
    return Embeddings(**{**header, "model": "histogram", **rows, **fields})


def track(**fields: Any) -> Track:
    """Build a confirmed track 1 that stands at the origin, with a detection in this frame."""
    motion = {"position_m": np.zeros(3), "velocity_mps": np.zeros(3), "covariance": np.eye(6)}
    life = {"state": "confirmed", "hits": 3, "age": 3, "time_since_update_s": 0.0}
    rest = {"yaw_rad": None, "detection": 0, "score": 0.9}
    return Track(**{"id": 1, **motion, **life, **rest, **fields})


def tracks(*people: Track, **fields: Any) -> Tracks:
    """Build the tracks in a frame of camera "front", in "map"."""
    names = {"frame_id": "map", "tracker": "test", "camera": "front"}
    return Tracks(**{**HEADER, **names, "tracks": people, **fields})


def truth_person(**fields: Any) -> TruthPerson:
    """Build person "a" of the ground truth, at the origin."""
    return TruthPerson(**{"id": "a", "position_m": np.zeros(3), **fields})


def truth(*people: TruthPerson, **fields: Any) -> Truth:
    """Build the ground truth at a time, in "map"."""
    return Truth(**{**HEADER, "frame_id": "map", "people": people, **fields})


def health(service: str = "detector", **fields: Any) -> Health:
    """Build a heartbeat of a service that is ready, process 1 on "host"."""
    process = {"instance": f"{service}-1", "host": "host", "pid": 1, "state": "ready"}
    return Health(**{**HEADER, "service": service, **process, **fields})
