"""Brings frames together with who was found and tracked in them."""

from collections import Counter
from dataclasses import dataclass

from people4d.messages import Detections, RgbdFrame, Tracks

WAITING_MAX = 256  # of all cameras, pictures or not
COUNTERS = ("without_frame", "frames_unused")


@dataclass(frozen=True, slots=True)
class Moment:
    """A frame with all that is known of it."""

    frame: RgbdFrame
    detections: Detections
    tracks: Tracks


@dataclass(slots=True)
class _Parts:
    """What of a moment has come."""

    frame: RgbdFrame | None = None
    detections: Detections | None = None
    tracks: Tracks | None = None


class Join:
    """Joins by camera and stamp, in bounded memory.

    Tracks come last, and those of a camera in order: who is complete shows that what is older and
    waits still will not be. Counted are `without_frame`, tracks whose frame was not kept, and
    `frames_unused`, frames without tracks: the detector passed them over, or they came too late.

    Args:
        frames: Most frames that wait.
    """

    def __init__(self, frames: int) -> None:
        self.counters = Counter(dict.fromkeys(COUNTERS, 0))
        self._frames = frames
        self._waiting: dict[tuple[str, int], _Parts] = {}

    def add(self, message: RgbdFrame | Detections | Tracks) -> Moment | None:
        """Take a message and return the moment that it completes, if it does."""
        key = message.camera, message.stamp_ns
        parts = self._waiting.setdefault(key, _Parts())
        if isinstance(message, RgbdFrame):
            parts.frame = message
            self._make_room()
        elif isinstance(message, Detections):
            parts.detections = message
        else:
            parts.tracks = message
        if parts.frame and parts.detections and parts.tracks:
            moment = Moment(parts.frame, parts.detections, parts.tracks)
            self._leave_behind(key)
            return moment
        while len(self._waiting) > WAITING_MAX:
            self._drop(next(iter(self._waiting)))
        return None

    def _make_room(self) -> None:
        with_frame = [key for key, parts in self._waiting.items() if parts.frame]
        for key in with_frame[: -self._frames]:
            self._drop(key)

    def _leave_behind(self, done: tuple[str, int]) -> None:
        """Forget a moment that is done, and what of its camera came before."""
        for key in list(self._waiting):
            if key == done:
                del self._waiting[key]
                return
            if key[0] == done[0]:
                self._drop(key)

    def _drop(self, key: tuple[str, int]) -> None:
        parts = self._waiting.pop(key)
        if parts.frame:
            self.counters["frames_unused"] += 1
        elif parts.detections and parts.tracks:
            self.counters["without_frame"] += 1
