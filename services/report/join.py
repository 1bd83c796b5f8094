"""Brings together what belongs to one frame."""

from dataclasses import dataclass

from people4d.messages import U8, Detections, RgbdFrame, Tracks


@dataclass(slots=True)
class Moment:
    """One frame and what was made of it; None for what did not come."""

    camera: str
    stamp_ns: int
    rgb: U8 | None = None
    detections: Detections | None = None
    tracks: Tracks | None = None

    @property
    def complete(self) -> bool:
        """Whether nothing is missing."""
        return all(part is not None for part in (self.rgb, self.detections, self.tracks))


class Join:
    """Joins frames, detections and tracks by camera and stamp, in bounded memory.

    The streams of a camera keep their order, so a complete moment shows that older ones of that
    camera will never be.

    Args:
        capacity: Moments that wait at most; the oldest is given up for a new one.
    """

    def __init__(self, capacity: int = 32) -> None:
        self._capacity = capacity
        self._waiting: dict[tuple[str, int], Moment] = {}

    def add(self, message: RgbdFrame | Detections | Tracks) -> list[Moment]:
        """Take a message and return the moments that are complete or given up, oldest first."""
        key = message.camera, message.stamp_ns
        moment = self._waiting.setdefault(key, Moment(*key))
        if isinstance(message, RgbdFrame):
            moment.rgb = message.rgb
        elif isinstance(message, Detections):
            moment.detections = message
        else:
            moment.tracks = message
        if moment.complete:
            return self._release(key)
        if len(self._waiting) > self._capacity:
            oldest = next(iter(self._waiting))
            return [self._waiting.pop(oldest)]
        return []

    def flush(self) -> list[Moment]:
        """Return all that still waits."""
        rest = list(self._waiting.values())
        self._waiting.clear()
        return rest

    def _release(self, last: tuple[str, int]) -> list[Moment]:
        released = []
        for key in list(self._waiting):
            if key[0] == last[0]:
                released.append(self._waiting.pop(key))
            if key == last:
                break
        return released
