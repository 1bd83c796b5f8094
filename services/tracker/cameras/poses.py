"""Poses of cameras at the time of each frame, in the frame of the tracks.

Tracks in a moving frame, for example the base of a robot, are filtered in the fixed frame below it
and transformed on output. This equals a correction of all states by the motion of the base (section
7 of docs/method.md), without its rounding errors.
"""

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from common.geometry.frame_graph import find_loop
from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transform_history import TransformEstimate
from common.geometry.transforms import LINK_FROM_OPTICAL, apply, wrap
from people4d.messages import F64, MovingTransform, Odometry, StaticTransform, Track
from people4d.messages.base import MAX_CAMERAS


class CameraPoseLookup:
    """Poses of fixed cameras, and of cameras on a base that moves.

    A camera without a transform is at the origin and looks along +x, unless one is `required`.
    """

    def __init__(self, frame_id: str, required: bool) -> None:
        self._frame_id, self._required = frame_id, required
        self._tracking_frame = frame_id
        self._buffer = TransformBuffer()
        self._fixed: dict[str, F64] = {}  # last used poses of fixed cameras
        self._parents: dict[str, str] = {}  # parent frames by frame, from fixed transforms
        self.loop: Sequence[str] = ()  # frames, see find_loop
        self.without_transform: set[str] = set()  # cameras without a transform

    @property
    def counters(self) -> dict[str, int]:
        """Anomalies of the motion of the base."""
        return dict(self._buffer.counters)

    @property
    def fixed(self) -> dict[str, F64]:
        """Poses (4x4) of the fixed cameras, for a checkpoint."""
        return dict(self._fixed)

    def restore(self, fixed: dict[str, F64]) -> None:
        """Use the poses of a checkpoint until transforms arrive."""
        self._fixed |= fixed

    def add_transform(self, message: StaticTransform | MovingTransform | Odometry) -> bool:
        """Add a transform; return True if it changes a pose in use."""
        changes = self._buffer.changes
        self._buffer.add_transform(message)
        if self._buffer.changes == changes:
            return False
        if isinstance(message, StaticTransform):
            self._parents[message.child] = message.parent
            # A first loop can only contain this frame.
            self.loop = find_loop(self._parents, () if self.loop else (message.child,))
        changed = self._update_tracking_frame()
        if not isinstance(message, StaticTransform):
            return changed
        for camera, before in tuple(self._fixed.items()):
            now = self._buffer.lookup_static(self._tracking_frame, camera)
            if now is not None and not np.array_equal(now, before):
                self._fixed[camera] = now
                changed = True
        return changed

    def lookup(self, camera: str, stamp_ns: int) -> TransformEstimate | None:
        """Return the pose of a camera's optical frame; None if it is unknown and required."""
        static = self._buffer.lookup_static(self._tracking_frame, camera)
        pose = None if static is None else TransformEstimate(static)
        pose = pose or self._buffer.lookup(self._tracking_frame, camera, stamp_ns)
        if pose is None and camera in self._fixed and camera not in self.without_transform:
            return TransformEstimate(self._fixed[camera])
        if pose is None:
            if len(self.without_transform) < MAX_CAMERAS:
                self.without_transform.add(camera)
            if self._required:
                return None
            pose = TransformEstimate(LINK_FROM_OPTICAL)
        else:
            self.without_transform.discard(camera)
        is_fixed = static is not None or camera in self.without_transform
        if is_fixed and (camera in self._fixed or len(self._fixed) < MAX_CAMERAS):
            self._fixed[camera] = pose.matrix
        return pose

    def to_output_frame(self, tracks: Sequence[Track], stamp_ns: int) -> Sequence[Track]:
        """Return tracks in the output frame; empty if its pose is unknown."""
        if self._tracking_frame == self._frame_id:
            return tracks
        transform = self._buffer.lookup(self._frame_id, self._tracking_frame, stamp_ns)
        return [] if transform is None else [transform_track(t, transform) for t in tracks]

    def awaits_sample(self, camera: str, stamp_ns: int) -> bool:
        """Check that a later sample may improve the pose of a camera at a time."""
        return self._buffer.awaits_sample(self._tracking_frame, camera, stamp_ns)

    def _update_tracking_frame(self) -> bool:
        """Choose the fixed frame below the output frame; return True if poses in use are lost."""
        frame = self._buffer.fixed_frame(self._frame_id)
        if frame == self._tracking_frame:
            return False
        self._tracking_frame, known = frame, bool(self._fixed)
        self._fixed.clear()
        return known


def transform_track(track: Track, transform: TransformEstimate) -> Track:
    """Return a track in another frame, both with z up; its velocity stays relative to the ground.

    The uncertainty of the transform (target_from_source) adds to the covariance.
    """
    matrix, rotation = transform.matrix, np.kron(np.eye(2), transform.matrix[:3, :3])
    turn_rad = float(np.arctan2(matrix[1, 0], matrix[0, 0]))
    position_m = apply(matrix, track.position_m)
    covariance = rotation @ track.covariance @ rotation.T
    covariance[:3, :3] += pose_covariance(position_m, transform)
    return replace(
        track,
        position_m=position_m,
        velocity_mps=matrix[:3, :3] @ track.velocity_mps,
        covariance=(covariance + covariance.T) / 2,
        yaw_rad=None if track.yaw_rad is None else wrap(track.yaw_rad + turn_rad),
    )


def pose_covariance(ray_m: F64, pose: TransformEstimate) -> F64:
    """Return the covariance (3x3) of a position due to the uncertainty of a pose.

    `ray_m` (3) points from the origin of the pose to the position, in the axes of its frame.
    """
    # A rotation about the vertical moves a point at right angles to the ray.
    aside_m = pose.sigma_rad * np.array([-ray_m[1], ray_m[0], 0.0])
    return pose.sigma_m**2 * np.diag([1.0, 1.0, 0.0]) + np.outer(aside_m, aside_m)
