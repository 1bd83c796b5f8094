"""Points, colours, poses and times of Foxglove."""

import numpy as np
from foxglove import messages as fox
from scipy.spatial.transform import Rotation

from common.drawing.strokes import colour_of
from people4d.messages import F64

S = 10**9


def stamp(stamp_ns: int) -> fox.Timestamp:
    """Return a time, clipped to the range of Foxglove, which begins in 1970."""
    seconds, nanoseconds = divmod(min(max(stamp_ns, 0), (2**32 - 1) * S), S)
    return fox.Timestamp(seconds, nanoseconds)


def colour(track_id: int | None, opacity: float = 1.0) -> fox.Color:
    """Return the colour of a track; grey without a track."""
    red, green, blue = (channel / 255 for channel in colour_of(track_id))
    return fox.Color(r=red, g=green, b=blue, a=opacity)


def point3(position_m: F64) -> fox.Point3:
    """Return a point."""
    x, y, z = (float(value) for value in position_m)
    return fox.Point3(x=x, y=y, z=z)


def pose_at(position_m: F64, yaw_rad: float = 0.0) -> fox.Pose:
    """Return a pose with a rotation about the vertical only."""
    x, y, z = (float(value) for value in position_m)
    rotation = fox.Quaternion(x=0, y=0, z=float(np.sin(yaw_rad / 2)), w=float(np.cos(yaw_rad / 2)))
    return fox.Pose(position=fox.Vector3(x=x, y=y, z=z), orientation=rotation)


def pose_parts(matrix: F64) -> tuple[fox.Vector3, fox.Quaternion]:
    """Return translation and rotation of a 4x4 transform."""
    x, y, z = (float(value) for value in matrix[:3, 3])
    qx, qy, qz, qw = Rotation.from_matrix(matrix[:3, :3]).as_quat()
    return fox.Vector3(x=x, y=y, z=z), fox.Quaternion(
        x=float(qx), y=float(qy), z=float(qz), w=float(qw)
    )
