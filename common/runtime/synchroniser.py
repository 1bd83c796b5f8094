"""Frames, detections and tracks, joined by stamp."""

from dataclasses import dataclass
from typing import TypeAlias

from people4d.messages import Detections, RgbdFrame, Tracks

FrameParts: TypeAlias = tuple[RgbdFrame, Detections, Tracks]


@dataclass(slots=True)
class SynchronisedFrame:
    """One frame with its detections and tracks; None for a missing message."""

    camera: str
    stamp_ns: int
    image: RgbdFrame | None = None
    detections: Detections | None = None
    tracks: Tracks | None = None

    def parts(self) -> FrameParts | None:
        """Return all three messages; None if one is missing."""
        if self.image and self.detections and self.tracks:
            return self.image, self.detections, self.tracks
        return None


class Synchroniser:
    """Joins frames, detections and tracks by camera and stamp, in bounded memory.

    Streams of a camera are in order, so frames older than a complete one stay incomplete.

    Args:
        capacity: Maximum number of waiting frames; the oldest is released for a new one.
        images_max: Maximum number of waiting frames with an image.
    """

    def __init__(self, capacity: int = 32, images_max: int | None = None) -> None:
        self._capacity = capacity
        self._images_max = images_max or capacity
        self._waiting: dict[tuple[str, int], SynchronisedFrame] = {}

    def add_message(self, message: RgbdFrame | Detections | Tracks) -> list[SynchronisedFrame]:
        """Add a message and return complete and released frames, oldest first."""
        key = message.camera, message.stamp_ns
        frame = self._waiting.setdefault(key, SynchronisedFrame(*key))
        if isinstance(message, RgbdFrame):
            frame.image = message
        elif isinstance(message, Detections):
            frame.detections = message
        else:
            frame.tracks = message
        if frame.parts():
            return self._release(key)
        with_image = [key for key, one in self._waiting.items() if one.image]
        surplus = with_image[: -self._images_max]
        if not surplus and len(self._waiting) > self._capacity:
            surplus = [next(iter(self._waiting))]
        return [self._waiting.pop(key) for key in surplus]

    def flush(self) -> list[SynchronisedFrame]:
        """Return all frames that still wait."""
        rest = list(self._waiting.values())
        self._waiting.clear()
        return rest

    def _release(self, last: tuple[str, int]) -> list[SynchronisedFrame]:
        """Release a complete frame, after the older ones of its camera."""
        released = []
        for key in list(self._waiting):
            if key[0] == last[0]:
                released.append(self._waiting.pop(key))
            if key == last:
                break
        return released
