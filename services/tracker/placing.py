"""Where cameras are at the time of each frame, in the frame that people are tracked in."""

import numpy as np

from common.geometry import LINK_FROM_OPTICAL
from common.messages import F64, MovingTransform, Odometry, StaticTransform
from common.moving_frames import MovingFrames
from common.trail import Placement, TrailConfig


class Places:
    """Cameras that stand, and cameras on a base that moves.

    Args:
        frame_id: Frame that people are tracked in.
        config: What motions of the base are believed.
        required: Whether a camera must have a transform; else it is taken to stand at the origin
            and to look along +x.
    """

    def __init__(self, frame_id: str, config: TrailConfig, required: bool) -> None:
        self._frame_id, self._required = frame_id, required
        self._frames = MovingFrames(config)
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
            Whether a camera by which people were placed stands elsewhere than thought.
        """
        self._frames.add(message)
        if not isinstance(message, StaticTransform):
            return False
        moved = False
        for camera, before in tuple(self._fixed.items()):
            now = self._frames.standing(self._frame_id, camera)
            if now is not None and not np.array_equal(now, before):
                self._fixed[camera] = now
                moved = True
        return moved

    def find(self, camera: str, stamp_ns: int) -> Placement | None:
        """Return where a camera was at a time.

        Args:
            camera: Name of its optical frame.
            stamp_ns: Time of a frame.

        Returns:
            None if that is not known, and has to be.
        """
        found = self._frames.find(self._frame_id, camera, stamp_ns)
        if found is None and camera in self._fixed and camera not in self.unplaced:
            return Placement(self._fixed[camera])
        if found is None:
            self.unplaced.add(camera)
            if self._required:
                return None
            found = Placement(LINK_FROM_OPTICAL)
        else:
            self.unplaced.discard(camera)
        if self._frames.standing(self._frame_id, camera) is not None or camera in self.unplaced:
            self._fixed[camera] = found.matrix
        return found

    def waits(self, camera: str, stamp_ns: int) -> bool:
        """Tell whether odometry may yet come that tells where a camera was at a time."""
        return self._frames.waits(self._frame_id, camera, stamp_ns)
