"""The results of one camera's frames, which several detectors may send."""

from collections import deque
from statistics import median

from people4d.messages import Detections

FIRST_PERIOD_NS = 50_000_000  # until two frames have come
PERIOD_MIN_NS, PERIOD_MAX_NS = 10_000_000, 500_000_000
PERIODS = 15  # of which the median is taken
REMEMBERED = 64  # frames given out by which a second result is known
DETECTORS_MAX = 256  # names kept, so that made-up ones fill no memory


class Stream:
    """What has come of one camera, and what may still come.

    Detectors share the frames, and each sends its results in order. So a frame that is missing
    comes no more once every one of them has sent a later one.
    """

    def __init__(self) -> None:
        self._newest: dict[str, int] = {}  # sequence by detector
        self._last: tuple[int, int] | None = None  # sequence and stamp of the last that came
        self._periods_ns: deque[int] = deque(maxlen=PERIODS)
        self._given: int | None = None  # sequence of the last given out
        self._given_stamps: deque[int] = deque(maxlen=REMEMBERED)

    def came(self, detections: Detections) -> None:
        """Note a result."""
        sequence, stamp_ns = detections.sequence, detections.stamp_ns
        self._newest.pop(detections.detector, None)
        self._newest[detections.detector] = sequence
        if len(self._newest) > DETECTORS_MAX:
            del self._newest[next(iter(self._newest))]
        if self._last and sequence > self._last[0]:
            self._periods_ns.append((stamp_ns - self._last[1]) // (sequence - self._last[0]))
        self._last = sequence, stamp_ns

    def gives(self, detections: Detections) -> int:
        """Note that a frame is given out; return how many before it never came."""
        given, self._given = self._given, detections.sequence
        self._given_stamps.append(detections.stamp_ns)
        return 0 if given is None else max(detections.sequence - given - 1, 0)

    def was_given(self, detections: Detections) -> bool:
        """Return whether this frame was given out lately."""
        return detections.stamp_ns in self._given_stamps

    @property
    def period_ns(self) -> int:
        """Time between two frames: the median of late."""
        period_ns = int(median(self._periods_ns)) if self._periods_ns else FIRST_PERIOD_NS
        return min(max(period_ns, PERIOD_MIN_NS), PERIOD_MAX_NS)

    def may_lack(self, detections: Detections) -> bool:
        """Return whether a frame before the oldest that waits may still come."""
        sequence, given = detections.sequence, self._given
        if sequence <= (0 if given is None else given + 1):
            return False
        others = set(detections.replicas) - {detections.detector}
        return any(self._newest.get(name, -1) < sequence for name in others)
