"""What odometry does to tracks is no fault of the tracker."""

from collections.abc import Iterable

import numpy as np
from msgspec.structs import replace

from common.geometry import apply, invert, wrap
from common.messages import F64, Message, MovingTransform, Odometry, StaticTransform, Track
from common.moving_frames import MovingFrames
from common.trail import TrailConfig


class Drift:
    """How far a driving robot errs about its own place.

    Args:
        messages: Transforms and odometry of a recording.
        frame_id: Frame that tracks are in.
        camera: Name of the optical frame.
    """

    def __init__(self, messages: Iterable[Message], frame_id: str, camera: str) -> None:
        self._ends = frame_id, camera
        self._frames = MovingFrames(TrailConfig(keep_s=1e9))
        for message in messages:
            if isinstance(message, StaticTransform | MovingTransform | Odometry):
                self._frames.add(message)
        self.drives = self._frames.standing(*self._ends) is None

    def true_from_told(self, stamp_ns: int, map_from_camera: F64 | None) -> F64 | None:
        """Return what carries tracks to where they would be without drift.

        Args:
            stamp_ns: Time of a frame.
            map_from_camera: 4x4, where the camera truly is; None: not known.

        Returns:
            4x4; None if the camera stands, or it is not known where it is.
        """
        if not self.drives or map_from_camera is None:
            return None
        told = self._frames.find(*self._ends, stamp_ns)
        return None if told is None else map_from_camera @ invert(told.matrix)


def carried(track: Track, matrix: F64 | None) -> Track:
    """Return a track moved and turned by a 4x4 transform of the ground; None: as it is."""
    if matrix is None:
        return track
    turn_rad = float(np.arctan2(matrix[1, 0], matrix[0, 0]))
    return replace(
        track,
        position_m=apply(matrix, track.position_m),
        velocity_mps=matrix[:3, :3] @ track.velocity_mps,
        yaw_rad=None if track.yaw_rad is None else wrap(track.yaw_rad + turn_rad),
    )
