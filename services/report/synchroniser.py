"""Frames, detections and tracks of one stamp, brought together."""

from dataclasses import dataclass

from people4d.messages import U8, Detections, RgbdFrame, Tracks


@dataclass(slots=True)
class SynchronisedFrame:
    """One frame with its detections and tracks; None for what did not arrive."""

    camera: str
    stamp_ns: int
    rgb: U8 | None = None
    detections: Detections | None = None
    tracks: Tracks | None = None

    @property
    def complete(self) -> bool:
        """True if nothing is missing."""
        return all(part is not None for part in (self.rgb, self.detections, self.tracks))


class Synchroniser:
    """Joins frames, detections and tracks by camera and stamp, in bounded memory.

    The streams of a camera are in order, so older frames than a complete one stay incomplete.

    Args:
        capacity: Frames that wait at most; the oldest is released for a new one.
    """

    def __init__(self, capacity: int = 32) -> None:
        self._capacity = capacity
        self._waiting: dict[tuple[str, int], SynchronisedFrame] = {}

    def add(self, message: RgbdFrame | Detections | Tracks) -> list[SynchronisedFrame]:
        """Take a message and return the frames that are complete or released, oldest first."""
        key = message.camera, message.stamp_ns
        frame = self._waiting.setdefault(key, SynchronisedFrame(*key))
        if isinstance(message, RgbdFrame):
            frame.rgb = message.rgb
        elif isinstance(message, Detections):
            frame.detections = message
        else:
            frame.tracks = message
        if frame.complete:
            return self._release(key)
        if len(self._waiting) > self._capacity:
            oldest = next(iter(self._waiting))
            return [self._waiting.pop(oldest)]
        return []

    def flush(self) -> list[SynchronisedFrame]:
        """Return all frames that still wait."""
        rest = list(self._waiting.values())
        self._waiting.clear()
        return rest

    def _release(self, last: tuple[str, int]) -> list[SynchronisedFrame]:
        released = []
        for key in list(self._waiting):
            if key[0] == last[0]:
                released.append(self._waiting.pop(key))
            if key == last:
                break
        return released
