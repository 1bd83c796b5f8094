"""People, tracks and a camera, built in one line each."""

import math

import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL, transform_from
from people4d.messages import Track, Tracks, Truth, TruthPerson
from tests import builders

MS = 1_000_000
OPTICAL = "front_optical_frame"

# f = 100 px, 200 x 100 px: 45 degrees to either side, 26.6 up and down; 5 m far.
INFO = builders.camera_info(
    frame_id=OPTICAL, width=200, height=100, fx=100.0, cx=99.5, cy=49.5, max_depth_m=5.0
)
# The camera stands 1 m above the origin of the map and looks along +x.
POSE = builders.static_transform(
    transform_from([0, 0, 1.0], np.eye(3)) @ LINK_FROM_OPTICAL, child=OPTICAL
)


def person(
    name: str, x: float, y: float, vx: float | None = None, yaw_deg: float | None = None
) -> TruthPerson:
    return TruthPerson(
        id=name,
        position_m=np.array([x, y, 1.0]),
        velocity_mps=None if vx is None else np.array([vx, 0.0, 0.0]),
        yaw_rad=None if yaw_deg is None else math.radians(yaw_deg),
    )


def truth(stamp_ms: float, *people: TruthPerson, frame_id: str = "map") -> Truth:
    return builders.truth(*people, stamp_ns=round(stamp_ms * MS), frame_id=frame_id)


def track(
    number: int,
    x: float,
    y: float,
    vx: float = 0.0,
    yaw_deg: float | None = None,
    lost: bool = False,
) -> Track:
    return Track(
        id=number,
        state="lost" if lost else "confirmed",
        position_m=np.array([x, y, 1.0]),
        velocity_mps=np.array([vx, 0.0, 0.0]),
        covariance=np.eye(6),
        yaw_rad=None if yaw_deg is None else math.radians(yaw_deg),
        hits=5,
        age=6,
        time_since_update_s=0.1 if lost else 0.0,
        detection=None if lost else 0,
        score=0.5,
    )


def tracks(stamp_ms: float, *people: Track, frame_id: str = "map") -> Tracks:
    return builders.tracks(*people, stamp_ns=round(stamp_ms * MS), frame_id=frame_id)
