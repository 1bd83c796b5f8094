"""Where cameras are at the time of each frame, in the frame that people are tracked in."""

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transform_history import TransformBufferConfig
from common.geometry.transforms import LINK_FROM_OPTICAL
from people4d.messages import F64, MovingTransform, Odometry, StaticTransform


class Places:
    """Cameras that stand, and cameras on a base that moves.

    Args:
        config: What motions of the base are believed.
    """

    def __init__(self, config: TransformBufferConfig) -> None:
        self._frames = TransformBuffer(config)
        self._known: set[tuple[str, str]] = set()

    @property
    def counters(self) -> dict[str, int]:
        """What was odd about the motion of the base."""
        return dict(self._frames.counters)

    def add(self, message: StaticTransform | MovingTransform | Odometry) -> None:
        """Take what is known of frames."""
        self._frames.add(message)

    def find(self, frame_id: str, camera: str, stamp_ns: int) -> F64 | None:
        """Return frame_from_optical of a camera.

        Args:
            frame_id: Frame that people are tracked in.
            camera: Name of the camera's optical frame.
            stamp_ns: Time of a frame.

        Returns:
            Where nothing is known of a camera, it stands at the origin and looks along +x: the
            tracker, whose people these are, takes it so. None where that is known, but not now.
        """
        found = self._frames.lookup(frame_id, camera, stamp_ns)
        if found is not None:
            self._known.add((frame_id, camera))
            return found.matrix
        return None if (frame_id, camera) in self._known else LINK_FROM_OPTICAL
