"""Join detections with the embeddings of their frame, in the order of their stamps."""

from collections import Counter, deque
from dataclasses import dataclass
from statistics import median

from people4d.messages import Detections, Embeddings
from services.tracker.config import TrackerConfig

ACTIVE_NS = 1_000_000_000
EARLY_MAX = 256
FIRST_PERIOD_NS = 50_000_000  # until two frames have come
PERIOD_MIN_NS, PERIOD_MAX_NS = 10_000_000, 500_000_000
PERIODS = 15  # of which the median is taken
RELEASED_MAX = 64  # stamps of released frames, to detect duplicates
DETECTORS_MAX = 256  # names, a bound against invented ones
COUNTERS = (
    *("embedding_timeouts", "without_embeddings", "late_embeddings"),
    *("duplicates", "stale", "missing"),
)


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


@dataclass(slots=True)
class PendingFrame:
    """Detections of one frame, and their embeddings once they are there."""

    detections: Detections
    arrived_ns: int  # [ns] monotonic
    embeddings: Embeddings | None = None


class FrameJoin:
    """Release frames by stamp, with their embeddings where these came in time.

    After some timeouts in a row embeddings are not waited for until they come again: a dead
    re-identification must not delay every frame.
    """

    def __init__(self, config: TrackerConfig, uses_embeddings: bool) -> None:
        self.counters = Counter(dict.fromkeys(COUNTERS, 0))
        self._embedding_ns = int(config.embedding_wait_s * 1e9) if uses_embeddings else 0
        self._timeouts_max = config.embedding_timeouts_max
        reorder_s = config.reorder_wait_s
        self._reorder_ns = None if reorder_s is None else int(reorder_s * 1e9)
        self._frames: list[PendingFrame] = []
        self._early: dict[tuple[str, int], Embeddings] = {}
        self._newest: dict[str, tuple[int, int]] = {}  # camera: newest stamp, monotonic arrival
        self._streams: dict[str, DetectionStream] = {}
        self._timeouts_in_row = 0

    @property
    def ignores_embeddings(self) -> bool:
        """Frames no longer wait for embeddings."""
        return self._timeouts_in_row >= self._timeouts_max

    @property
    def waiting(self) -> bool:
        """A frame waits."""
        return bool(self._frames)

    def newest_ns(self, camera: str) -> int | None:
        """Return the newest stamp of a camera."""
        newest = self._newest.get(camera)
        return newest[0] if newest else None

    def add_detections(self, detections: Detections, now_ns: int, late: bool = False) -> None:
        """Add a frame; a duplicate or one that is too late is counted and dropped."""
        key = (detections.camera, detections.stamp_ns)
        stream = self._stream(detections)
        stream.add(detections)
        if stream.was_released(detections) or any(_key(frame) == key for frame in self._frames):
            self.counters["duplicates"] += 1
            return
        if late:
            self.counters["stale"] += 1
            return
        newest = self.newest_ns(detections.camera)
        newest = detections.stamp_ns if newest is None else max(newest, detections.stamp_ns)
        self._newest[detections.camera] = newest, now_ns
        self._frames.append(PendingFrame(detections, now_ns, self._early.pop(key, None)))
        self._frames.sort(key=lambda frame: (frame.detections.stamp_ns, frame.detections.camera))

    def add_embeddings(self, embeddings: Embeddings, late: bool) -> None:
        """Add embeddings to their frame, or store them until it comes, unless they are late."""
        self._timeouts_in_row = 0
        key = (embeddings.camera, embeddings.stamp_ns)
        for frame in self._frames:
            if _key(frame) == key:
                frame.embeddings = embeddings
                return
        if late:
            self.counters["late_embeddings"] += 1
            return
        self._early[key] = embeddings
        while len(self._early) > EARLY_MAX:
            del self._early[next(iter(self._early))]

    def pop(self, now_ns: int, flush: bool = False) -> PendingFrame | None:
        """Return the next frame if it need not wait any longer."""
        if not self._frames:
            return None
        frame = self._frames[0]
        if not flush and now_ns < self._due_ns(frame):
            return None
        del self._frames[0]
        self.counters["missing"] += self._stream(frame.detections).release(frame.detections)
        if self._lacks_embeddings(frame):
            self.counters["without_embeddings"] += 1
            if not self.ignores_embeddings:
                self.counters["embedding_timeouts"] += 1
                self._timeouts_in_row += 1
        return frame

    def wake_ns(self) -> int | None:
        """Return the monotonic time at which the next frame has waited long enough."""
        return self._due_ns(self._frames[0]) if self._frames else None

    def restart(self, stamp_ns: int) -> None:
        """Restart at a stamp after a clock reset."""
        self._newest.clear()
        self._streams.clear()
        self._early = {key: e for key, e in self._early.items() if e.stamp_ns <= stamp_ns}

    def _lacks_embeddings(self, frame: PendingFrame) -> bool:
        wanted = self._embedding_ns > 0 and len(frame.detections.detections) > 0
        return wanted and frame.embeddings is None

    def _due_ns(self, frame: PendingFrame) -> int:
        lacks = self._lacks_embeddings(frame) and not self.ignores_embeddings
        wait_ns = self._embedding_ns if lacks else 0
        stream = self._stream(frame.detections)
        if self._is_ahead(frame) or stream.may_lack(frame.detections):
            reorder_ns = self._reorder_ns
            wait_ns = max(wait_ns, stream.period_ns if reorder_ns is None else reorder_ns)
        return frame.arrived_ns + wait_ns

    def _is_ahead(self, frame: PendingFrame) -> bool:
        """Check that another camera may still send an earlier frame."""
        return any(
            newest < frame.detections.stamp_ns and frame.arrived_ns - arrived < ACTIVE_NS
            for camera, (newest, arrived) in self._newest.items()
            if camera != frame.detections.camera
        )

    def _stream(self, detections: Detections) -> DetectionStream:
        return self._streams.setdefault(detections.camera, DetectionStream())


def _key(frame: PendingFrame) -> tuple[str, int]:
    return frame.detections.camera, frame.detections.stamp_ns
