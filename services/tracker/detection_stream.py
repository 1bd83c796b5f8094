"""Detections of one camera, from one or several detectors."""

from collections import deque
from statistics import median

from people4d.messages import Detections

FIRST_PERIOD_NS = 50_000_000  # until two frames have come
PERIOD_MIN_NS, PERIOD_MAX_NS = 10_000_000, 500_000_000
PERIODS = 15  # of which the median is taken
RELEASED_MAX = 64  # stamps of released frames, to detect duplicates
DETECTORS_MAX = 256  # names, a bound against invented ones


class DetectionStream:
    """Sequence numbers and stamps of one camera's detections.

    Detectors share the frames, and each sends its results in order. So a missing frame will not
    come any more once every one of them has sent a later one.
    """

    def __init__(self) -> None:
        self._newest: dict[str, int] = {}  # sequence by detector
        self._last: tuple[int, int] | None = None  # sequence and stamp of the last added
        self._periods_ns: deque[int] = deque(maxlen=PERIODS)
        self._released: int | None = None  # sequence of the last released
        self._released_stamps: deque[int] = deque(maxlen=RELEASED_MAX)

    def add(self, detections: Detections) -> None:
        """Record the arrival of detections."""
        sequence, stamp_ns = detections.sequence, detections.stamp_ns
        self._newest.pop(detections.detector, None)
        self._newest[detections.detector] = sequence
        if len(self._newest) > DETECTORS_MAX:
            del self._newest[next(iter(self._newest))]
        if self._last and sequence > self._last[0]:
            self._periods_ns.append((stamp_ns - self._last[1]) // (sequence - self._last[0]))
        self._last = sequence, stamp_ns

    def release(self, detections: Detections) -> int:
        """Record that a frame goes to the tracker; return how many before it never came."""
        before, self._released = self._released, detections.sequence
        self._released_stamps.append(detections.stamp_ns)
        return 0 if before is None else max(detections.sequence - before - 1, 0)

    def was_released(self, detections: Detections) -> bool:
        """Check that this frame went to the tracker already."""
        return detections.stamp_ns in self._released_stamps

    @property
    def period_ns(self) -> int:
        """Time between two frames: the median of the last ones."""
        period_ns = int(median(self._periods_ns)) if self._periods_ns else FIRST_PERIOD_NS
        return min(max(period_ns, PERIOD_MIN_NS), PERIOD_MAX_NS)

    def may_lack(self, detections: Detections) -> bool:
        """Check that a frame before the oldest pending one may still come."""
        sequence, released = detections.sequence, self._released
        if sequence <= (0 if released is None else released + 1):
            return False
        others = set(detections.replicas) - {detections.detector}
        return any(self._newest.get(name, -1) < sequence for name in others)
