"""Drift of odometry, which is taken out of tracks: it is no error of the tracker."""

from collections.abc import Iterable

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transform_history import TransformBufferConfig, TransformEstimate
from common.geometry.transforms import invert
from people4d.messages import F64, Message, MovingTransform, Odometry, StaticTransform, Track
from services.tracker import camera_poses


class OdometryDrift:
    """Error of a driving robot's estimate of its own pose.

    Args:
        messages: Transforms and odometry of a recording.
        frame_id: Frame that tracks are in.
        camera: Name of the optical frame.
    """

    def __init__(self, messages: Iterable[Message], frame_id: str, camera: str) -> None:
        self._ends = frame_id, camera
        self._transforms = TransformBuffer(TransformBufferConfig(history_s=1e9))
        for message in messages:
            if isinstance(message, StaticTransform | MovingTransform | Odometry):
                self._transforms.add(message)
        self.drives = self._transforms.lookup_static(*self._ends) is None

    def true_from_estimated(self, stamp_ns: int, map_from_camera: F64 | None) -> F64 | None:
        """Return the transform of tracks to their positions without drift.

        Args:
            stamp_ns: Time of a frame.
            map_from_camera: 4x4, true pose of the camera; None if unknown.

        Returns:
            4x4; None if the camera stands, or its pose is unknown.
        """
        if not self.drives or map_from_camera is None:
            return None
        estimated = self._transforms.lookup(*self._ends, stamp_ns)
        return None if estimated is None else map_from_camera @ invert(estimated.matrix)


def transform_track(track: Track, matrix: F64 | None) -> Track:
    """Return a track moved and turned by a 4x4 transform of the ground; None: as it is."""
    if matrix is None:
        return track
    return camera_poses.transform_track(track, TransformEstimate(matrix))
