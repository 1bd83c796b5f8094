"""Transforms in untrusted tf2_msgs/TFMessage."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from common.geometry.transforms import transform_from
from common.ros2.frame_names import frame_name
from people4d.errors import DecodeError
from people4d.messages import F64, MovingTransform


@dataclass(frozen=True)
class StampedTransform:
    """One transform of a tf2_msgs/TFMessage, with names stripped of slashes."""

    parent: str
    child: str
    stamp_ns: int  # stamp; 0 if unknown
    matrix: F64  # 4x4, parent_from_child

    def moving(self, stamp_ns: int, sequence: int) -> MovingTransform:
        """Return a message; DecodeError if it is not rigid or its stamp is out of range."""
        try:
            return MovingTransform(
                stamp_ns=stamp_ns,
                sequence=sequence,
                parent=frame_name(self.parent),
                child=frame_name(self.child),
                matrix=self.matrix,
            )
        except ValueError as error:
            raise DecodeError(f"transform: {error}") from error


def edges_of(message: Any) -> Iterator[StampedTransform]:
    """Yield the valid transforms of a tf2_msgs/TFMessage."""
    for item in message.transforms:
        matrix = matrix_of(item.transform)
        if matrix is not None:
            parent, child = item.header.frame_id.strip("/"), item.child_frame_id.strip("/")
            yield StampedTransform(parent, child, stamp_of(item), matrix)


def matrix_of(transform: Any) -> F64 | None:
    """Return a geometry_msgs/Transform as 4x4, None if it is invalid."""
    t, q = transform.translation, transform.rotation
    try:
        rotation = Rotation.from_quat((q.x, q.y, q.z, q.w)).as_matrix()
    except ValueError:  # zero quaternion
        return None
    matrix = transform_from((t.x, t.y, t.z), rotation)
    return matrix if np.all(np.isfinite(matrix)) else None


def stamp_of(message: Any) -> int:
    """Return the stamp in a header [ns], 0 if the driver does not set it."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
