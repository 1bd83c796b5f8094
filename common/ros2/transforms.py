"""Transforms in tf2_msgs/TFMessage, whose bytes are untrusted."""

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
    """One transform of a tf2_msgs/TFMessage, its names without slashes at either end."""

    parent: str
    child: str
    stamp_ns: int  # [ns] 0 if it has none
    matrix: F64  # 4x4, parent_from_child

    def moving(self, stamp_ns: int, sequence: int) -> MovingTransform:
        """Return it as a message; DecodeError if it is not rigid or its stamp is out of range."""
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
    """Yield the transforms of a tf2_msgs/TFMessage that are valid."""
    for item in message.transforms:
        t, q = item.transform.translation, item.transform.rotation
        try:
            rotation = Rotation.from_quat((q.x, q.y, q.z, q.w)).as_matrix()
        except ValueError:  # zero
            continue
        matrix = transform_from((t.x, t.y, t.z), rotation)
        if np.all(np.isfinite(matrix)):
            parent, child = item.header.frame_id.strip("/"), item.child_frame_id.strip("/")
            yield StampedTransform(parent, child, stamp_of(item), matrix)


def stamp_of(message: Any) -> int:
    """Return the stamp in a header [ns], 0 if a driver leaves it empty."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
