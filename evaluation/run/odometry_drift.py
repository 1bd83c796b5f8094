"""What odometry does to tracks is no fault of the tracker."""

from collections.abc import Iterable

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transform_history import TransformBufferConfig, TransformEstimate
from common.geometry.transforms import invert
from people4d.messages import F64, Message, MovingTransform, Odometry, StaticTransform, Track
from services.tracker import camera_poses


class OdometryDrift:
    """How far a driving robot errs about its own place.

    Args:
        messages: Transforms and odometry of a recording.
        frame_id: Frame that tracks are in.
        camera: Name of the optical frame.
    """

    def __init__(self, messages: Iterable[Message], frame_id: str, camera: str) -> None:
        self._ends = frame_id, camera
        self._frames = TransformBuffer(TransformBufferConfig(history_s=1e9))
        for message in messages:
            if isinstance(message, StaticTransform | MovingTransform | Odometry):
                self._frames.add(message)
        self.drives = self._frames.lookup_static(*self._ends) is None

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
        told = self._frames.lookup(*self._ends, stamp_ns)
        return None if told is None else map_from_camera @ invert(told.matrix)


def transform_track(track: Track, matrix: F64 | None) -> Track:
    """Return a track moved and turned by a 4x4 transform of the ground; None: as it is."""
    if matrix is None:
        return track
    return camera_poses.transform_track(track, TransformEstimate(matrix))
