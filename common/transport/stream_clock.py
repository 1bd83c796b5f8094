"""Wall times of the stamps of a stream: a recording or simulation is mapped to its playback.

Stamps near the wall clock are wall times. Others get an offset, from the time of sending in the
trace of the message, or else from its arrival. The offset is constant until a recording jumps or is
played too slowly.
"""

import time
from collections.abc import Callable, Sequence

from people4d.messages import Message, Span
from people4d.messages.base import MAX_CAMERAS
from people4d.topics import BY_MESSAGE

EXTRAPOLATION_MAX_NS = 500_000_000  # maximum extrapolation by velocity [ns]
AHEAD_MAX_NS = 1_000_000_000  # maximum lead of a live stamp over the wall clock [ns]
LATE_MAX_NS = 10_000_000_000  # maximum delay of a live stamp behind the wall clock [ns]
JITTER_NS = 100_000_000  # jitter of the times of sending [ns]
UNTRACED_NS = 1_000_000_000  # jitter of the arrivals of messages without a trace [ns]
SENDING = (".capture", ".release")  # stages of a source, at which a message is sent


class StreamClock:
    """Wall times of the stamps of a stream of one or several cameras."""

    def __init__(self, wall_ns: Callable[[], int] = time.time_ns) -> None:
        self._wall_ns = wall_ns
        # Wall time minus stamp [ns] by camera, in the order of their first messages; messages of no
        # camera have an empty name.
        self._offsets_ns: dict[str, int] = {}

    def wall_ns(self, message: Message) -> int:
        """Return the wall time of the stamp of a message that arrives now."""
        camera = BY_MESSAGE[type(message)].clock_of(message)
        now_ns = self._wall_ns()
        sent_ns = _sent_ns(message.trace, now_ns)
        tolerance_ns = UNTRACED_NS if sent_ns is None else JITTER_NS
        offset_ns = (now_ns if sent_ns is None else sent_ns) - message.stamp_ns
        if -AHEAD_MAX_NS <= offset_ns <= LATE_MAX_NS:
            offset_ns = 0
        if camera in self._offsets_ns:
            if abs(offset_ns - self._offsets_ns[camera]) > tolerance_ns:
                self._offsets_ns[camera] = offset_ns
        elif len(self._offsets_ns) < MAX_CAMERAS:
            self._offsets_ns[camera] = offset_ns
        return message.stamp_ns + self._shared_ns(camera)

    def _shared_ns(self, camera: str) -> int:
        """Return the offset of the first camera whose offset is similar."""
        offsets_ns = list(self._offsets_ns.values())
        own_ns = self._offsets_ns.get(camera, offsets_ns[0])
        return next(ns for ns in offsets_ns if abs(ns - own_ns) <= UNTRACED_NS)


def _sent_ns(trace: Sequence[Span], now_ns: int) -> int | None:
    """Return the wall time of sending; None if it is unknown or the trace is replayed."""
    sending = (span.start_ns for span in trace if span.stage.endswith(SENDING))
    sent_ns = next(sending, None)
    if sent_ns is None or not -AHEAD_MAX_NS <= now_ns - sent_ns <= LATE_MAX_NS:
        return None
    return sent_ns
