"""Where cameras are at the time of each frame, in the frame that people are tracked in.

If tracks are wanted in a frame that moves, of a robot's base, people are followed on the ground
that it moves on, and told as the base sees them then: that is to move all states by the base's full
motion from frame to frame (method book section 7), without a rounding at each step.
"""

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transform_history import TransformBufferConfig, TransformEstimate
from common.geometry.transforms import LINK_FROM_OPTICAL, apply, wrap
from people4d.messages import F64, MovingTransform, Odometry, StaticTransform, Track


class Places:
    """Cameras that stand, and cameras on a base that moves.

    Args:
        frame_id: Frame that tracks are wanted in.
        config: What motions of the base are believed.
        required: Whether a camera must have a transform; else it is taken to stand at the origin
            and to look along +x.
    """

    def __init__(self, frame_id: str, config: TransformBufferConfig, required: bool) -> None:
        self._frame_id, self._required = frame_id, required
        self._ground = frame_id
        self._frames = TransformBuffer(config)
        self._fixed: dict[str, F64] = {}  # cameras that stand, as people were placed by them last
        self.unplaced: set[str] = set()  # cameras without a transform

    @property
    def counters(self) -> dict[str, int]:
        """What was odd about the motion of the base."""
        return dict(self._frames.counters)

    @property
    def fixed(self) -> dict[str, F64]:
        """Where the cameras that stand are, to be kept for another process."""
        return dict(self._fixed)

    def remember(self, fixed: dict[str, F64]) -> None:
        """Take what another process kept, until transforms come."""
        self._fixed |= fixed

    def add(self, message: StaticTransform | MovingTransform | Odometry) -> bool:
        """Take what is known of frames.

        Returns:
            Whether a camera by which people were placed stands elsewhere than thought, or moves.
        """
        self._frames.add(message)
        moved = self._follow_ground()
        if not isinstance(message, StaticTransform):
            return moved
        for camera, before in tuple(self._fixed.items()):
            now = self._frames.lookup_static(self._ground, camera)
            if now is not None and not np.array_equal(now, before):
                self._fixed[camera] = now
                moved = True
        return moved

    def find(self, camera: str, stamp_ns: int) -> TransformEstimate | None:
        """Return where a camera was at a time.

        Args:
            camera: Name of its optical frame.
            stamp_ns: Time of a frame.

        Returns:
            None if that is not known, and has to be.
        """
        found = self._frames.lookup(self._ground, camera, stamp_ns)
        if found is None and camera in self._fixed and camera not in self.unplaced:
            return TransformEstimate(self._fixed[camera])
        if found is None:
            self.unplaced.add(camera)
            if self._required:
                return None
            found = TransformEstimate(LINK_FROM_OPTICAL)
        else:
            self.unplaced.discard(camera)
        if self._frames.lookup_static(self._ground, camera) is not None or camera in self.unplaced:
            self._fixed[camera] = found.matrix
        return found

    def told(self, tracks: Sequence[Track], stamp_ns: int) -> Sequence[Track]:
        """Return tracks in the frame that is wanted; nobody if nobody tells where that is."""
        if self._ground == self._frame_id:
            return tracks
        place = self._frames.lookup(self._frame_id, self._ground, stamp_ns)
        return [] if place is None else [carried(track, place) for track in tracks]

    def waits(self, camera: str, stamp_ns: int) -> bool:
        """Tell whether odometry may yet come that tells where a camera was at a time."""
        return self._frames.awaits_sample(self._ground, camera, stamp_ns)

    def _follow_ground(self) -> bool:
        """Notice that tracks are wanted in a frame that moves."""
        ground = self._frames.fixed_frame(self._frame_id)
        if ground == self._ground:
            return False
        self._ground, known = ground, bool(self._fixed)
        self._fixed.clear()
        return known


def carried(track: Track, place: TransformEstimate) -> Track:
    """Return a track in another frame, both with z up; its velocity stays that over the ground.

    Args:
        track: In the source frame.
        place: The other frame, from the source; what is guessed of it is doubted.
    """
    matrix, turn = place.matrix, np.kron(np.eye(2), place.matrix[:3, :3])
    turn_rad = float(np.arctan2(matrix[1, 0], matrix[0, 0]))
    position_m = apply(matrix, track.position_m)
    covariance = turn @ track.covariance @ turn.T
    covariance[:3, :3] += doubt(position_m, place)
    return replace(
        track,
        position_m=position_m,
        velocity_mps=matrix[:3, :3] @ track.velocity_mps,
        covariance=(covariance + covariance.T) / 2,
        yaw_rad=None if track.yaw_rad is None else wrap(track.yaw_rad + turn_rad),
    )


def doubt(away_m: F64, place: TransformEstimate) -> F64:
    """Return the covariance (3x3) of a position because where the camera or the base is is a guess.

    Args:
        away_m: 3, from there, with axes as in the frame that the position is in.
        place: What is guessed.
    """
    # A turn about the vertical moves what is seen at right angles to the way there.
    aside_m = place.sigma_rad * np.array([-away_m[1], away_m[0], 0.0])
    return place.sigma_m**2 * np.diag([1.0, 1.0, 0.0]) + np.outer(aside_m, aside_m)
