"""Inputs of the node: frames joined with detections and tracks, and transforms of cameras."""

from collections import Counter
from dataclasses import dataclass

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transform_history import TransformBufferConfig
from common.geometry.transforms import LINK_FROM_OPTICAL
from people4d.messages import (
    F64,
    Detections,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
    Tracks,
)

PENDING_MAX = 256  # of all cameras, with images or without
SYNCHRONISER_COUNTERS = ("without_frame", "frames_unused")


@dataclass(frozen=True, slots=True)
class TrackedFrame:
    """A frame with the detections and tracks of its stamp."""

    frame: RgbdFrame
    detections: Detections
    tracks: Tracks


@dataclass(slots=True)
class _PendingFrame:
    frame: RgbdFrame | None = None
    detections: Detections | None = None
    tracks: Tracks | None = None


class FrameSynchroniser:
    """Joins messages by camera and stamp, in bounded memory.

    Tracks come last, and those of a camera in order: older pending frames of the camera will not be
    completed. Counted are `without_frame`, tracks whose frame was dropped, and `frames_unused`,
    frames without tracks: the detector skipped them, or the tracks came too late.

    Args:
        frames: Most pending frames.
    """

    def __init__(self, frames: int) -> None:
        self.counters = Counter(dict.fromkeys(SYNCHRONISER_COUNTERS, 0))
        self._frames = frames
        self._pending: dict[tuple[str, int], _PendingFrame] = {}

    def add(self, message: RgbdFrame | Detections | Tracks) -> TrackedFrame | None:
        """Add a message and return the frame that it completes, if it does."""
        key = message.camera, message.stamp_ns
        pending = self._pending.setdefault(key, _PendingFrame())
        if isinstance(message, RgbdFrame):
            pending.frame = message
            self._drop_surplus_frames()
        elif isinstance(message, Detections):
            pending.detections = message
        else:
            pending.tracks = message
        if pending.frame and pending.detections and pending.tracks:
            self._drop_older(key)
            return TrackedFrame(pending.frame, pending.detections, pending.tracks)
        while len(self._pending) > PENDING_MAX:
            self._drop(next(iter(self._pending)))
        return None

    def _drop_surplus_frames(self) -> None:
        with_frame = [key for key, pending in self._pending.items() if pending.frame]
        for key in with_frame[: -self._frames]:
            self._drop(key)

    def _drop_older(self, done: tuple[str, int]) -> None:
        """Delete a complete frame, and the pending ones of its camera that came before."""
        for key in list(self._pending):
            if key == done:
                del self._pending[key]
                return
            if key[0] == done[0]:
                self._drop(key)

    def _drop(self, key: tuple[str, int]) -> None:
        pending = self._pending.pop(key)
        if pending.frame:
            self.counters["frames_unused"] += 1
        elif pending.detections and pending.tracks:
            self.counters["without_frame"] += 1


class CameraTransforms:
    """Poses of fixed cameras, and of cameras on a moving base.

    Args:
        config: Plausible motion of the base.
    """

    def __init__(self, config: TransformBufferConfig) -> None:
        self._transforms = TransformBuffer(config)
        self._known: set[tuple[str, str]] = set()

    @property
    def counters(self) -> dict[str, int]:
        """Implausible motions of the base."""
        return dict(self._transforms.counters)

    def add(self, message: StaticTransform | MovingTransform | Odometry) -> None:
        """Add a transform."""
        self._transforms.add(message)

    def lookup(self, frame_id: str, optical_frame_id: str, stamp_ns: int) -> F64 | None:
        """Return the pose of a camera, 4x4, frame_from_optical.

        Args:
            frame_id: Coordinate frame of the tracks.
            optical_frame_id: Optical frame of the camera.
            stamp_ns: Time.

        Returns:
            At the origin, looking along +x, where no transform of the camera was ever known, as in
            the tracker. None where one was known, but not at this time.
        """
        found = self._transforms.lookup(frame_id, optical_frame_id, stamp_ns)
        if found is not None:
            self._known.add((frame_id, optical_frame_id))
            return found.matrix
        return None if (frame_id, optical_frame_id) in self._known else LINK_FROM_OPTICAL
