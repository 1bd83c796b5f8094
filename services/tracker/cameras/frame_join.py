"""Join of detections and embeddings by frame, released in the order of stamps."""

from collections import Counter, deque
from dataclasses import dataclass
from statistics import median
from typing import TypeAlias

from people4d.messages import Detections, Embeddings
from people4d.messages.base import MAX_CAMERAS
from services.tracker.cameras.stamp_guard import JUMP_NS
from services.tracker.config import TrackerConfig

ACTIVE_NS = 1_000_000_000  # maximum silence of an active camera [ns]
TIMEOUTS_MAX = 3  # maximum number of consecutive timeouts before frames stop waiting for embeddings
EARLY_MAX = 64  # maximum number of stored embeddings without detections
EARLY_MAX_BYTES = 16 * 2**20  # maximum total size of waiting embeddings [bytes]
FIRST_PERIOD_NS = 50_000_000  # assumed period before the second frame [ns]
PERIOD_MIN_NS, PERIOD_MAX_NS = 10_000_000, 500_000_000  # limits of the period [ns]
PERIODS = 15  # number of periods in the running median
RELEASED_MAX = 64  # number of stored stamps of released frames, which reveal duplicates
DETECTORS_MAX = 256  # maximum number of stored names of detectors
FrameKey: TypeAlias = tuple[str, int, int]  # camera, stamp and sequence
COUNTERS = (
    *("embedding_timeouts", "without_embeddings", "late_embeddings"),
    *("duplicates", "stale", "missing"),
)


class DetectionStream:
    """Sequence numbers and stamps of one camera's detections.

    Detectors share the frames, and each sends its results in order. A missing frame is lost once
    every detector has sent a later one.
    """

    def __init__(self) -> None:
        self._newest: dict[str, int] = {}  # newest sequence number by detector
        self._last: tuple[int, int] | None = None  # sequence and stamp of the last frame added
        self._periods_ns: deque[int] = deque(maxlen=PERIODS)
        # Sequence and stamp of released frames, newest last
        self._released: deque[tuple[int, int]] = deque(maxlen=RELEASED_MAX)

    def add_detections(self, detections: Detections) -> None:
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
        """Record the release of a frame; return the number of missing frames before it."""
        before, _ = self._released[-1] if self._released else (detections.sequence, 0)
        self._released.append((detections.sequence, detections.stamp_ns))
        return max(detections.sequence - before - 1, 0)

    def was_released(self, detections: Detections) -> bool:
        """Return True if this frame was released before."""
        return (detections.sequence, detections.stamp_ns) in self._released

    def is_late(self, message: Detections | Embeddings) -> bool:
        """Return True if a later frame was released before.

        Stamps may be equal or jitter: a frame of a higher sequence number is never late.
        """
        if not self._released:
            return False
        sequence, stamp_ns = self._released[-1]
        return message.sequence <= sequence and message.stamp_ns <= stamp_ns

    def behind_ns(self, message: Embeddings) -> int:
        """Return the age of a message relative to the last released frame [ns]."""
        return self._released[-1][1] - message.stamp_ns if self._released else 0

    @property
    def period_ns(self) -> int:
        """Median time between two frames [ns]."""
        period_ns = int(median(self._periods_ns)) if self._periods_ns else FIRST_PERIOD_NS
        return min(max(period_ns, PERIOD_MIN_NS), PERIOD_MAX_NS)

    def may_lack(self, detections: Detections) -> bool:
        """Return True if a frame before the oldest pending one may still arrive."""
        sequence, released = detections.sequence, self._released
        if sequence <= (released[-1][0] + 1 if released else 0):
            return False
        others = set(detections.replicas) - {detections.detector}
        return any(self._newest.get(name, -1) < sequence for name in others)


@dataclass(slots=True)
class PendingFrame:
    """Detections of one frame, with their embeddings once these arrive."""

    detections: Detections
    time_ns: int  # [ns] its stamp in the common time of all cameras
    arrived_ns: int  # [ns] monotonic arrival
    embeddings: Embeddings | None = None


class FrameJoin:
    """Releases frames by stamp, with the embeddings that arrived in time.

    After TIMEOUTS_MAX consecutive timeouts frames do not wait until embeddings arrive again: a
    failed re-identification must not delay every frame.
    """

    def __init__(self, config: TrackerConfig, uses_embeddings: bool) -> None:
        self.counters = Counter(dict.fromkeys(COUNTERS, 0))
        self._embedding_ns = int(config.embedding_wait_s * 1e9) if uses_embeddings else 0
        reorder_s = config.reorder_wait_s
        self._reorder_ns = None if reorder_s is None else int(reorder_s * 1e9)
        self._frames: list[PendingFrame] = []
        self._early: dict[FrameKey, Embeddings] = {}
        self._newest: dict[str, tuple[int, int]] = {}  # newest time and its arrival, by camera
        self._streams: dict[str, DetectionStream] = {}
        self._timeouts_in_row = 0

    @property
    def ignores_embeddings(self) -> bool:
        """True if frames no longer wait for embeddings."""
        return self._timeouts_in_row >= TIMEOUTS_MAX

    @property
    def waiting(self) -> bool:
        """True if a frame waits."""
        return bool(self._frames)

    def add_detections(
        self, detections: Detections, time_ns: int, now_ns: int, late: bool = False
    ) -> None:
        """Add a frame; count and drop a duplicate or late one.

        Args:
            detections: Detections of the frame.
            time_ns: Stamp in the common time of all cameras.
            now_ns: Monotonic time.
            late: The tracker cannot go back to its time.
        """
        camera, key = detections.camera, _key(detections)
        stream = self._stream(camera)
        stream.add_detections(detections)
        if stream.was_released(detections) or any(_key(f.detections) == key for f in self._frames):
            self.counters["duplicates"] += 1
            return
        if late or stream.is_late(detections):
            self.counters["stale"] += 1
            return
        newest_ns, _ = self._newest.pop(camera, (time_ns, now_ns))
        self._newest[camera] = max(newest_ns, time_ns), now_ns
        if len(self._newest) > MAX_CAMERAS:
            del self._newest[next(iter(self._newest))]
        self._frames.append(PendingFrame(detections, time_ns, now_ns, self._early.pop(key, None)))
        self._frames.sort(key=lambda f: (f.time_ns, f.detections.camera, f.detections.sequence))

    def add_embeddings(self, embeddings: Embeddings) -> None:
        """Add embeddings to their frame, or store them until it arrives, unless late."""
        self._timeouts_in_row = 0
        key = _key(embeddings)
        for frame in self._frames:
            if _key(frame.detections) == key:
                frame.embeddings = embeddings
                return
        if self._is_late(embeddings):
            # Without vectors: of a frame without crops, which does not wait.
            self.counters["late_embeddings"] += len(embeddings.vectors) > 0
            return
        self._early[key] = embeddings
        size = sum(waiting.vectors.nbytes for waiting in self._early.values())
        while len(self._early) > EARLY_MAX or size > EARLY_MAX_BYTES:
            size -= self._early.pop(next(iter(self._early))).vectors.nbytes
            self.counters["late_embeddings"] += 1

    def pop(self, now_ns: int, flush: bool = False) -> PendingFrame | None:
        """Return the next frame if it need not wait any longer."""
        if not self._frames:
            return None
        frame = self._frames[0]
        if not flush and now_ns < self._due_ns(frame):
            return None
        del self._frames[0]
        stream = self._stream(frame.detections.camera)
        self.counters["missing"] += stream.release(frame.detections)
        if self._lacks_embeddings(frame):
            self.counters["without_embeddings"] += 1
            if not self.ignores_embeddings:
                self.counters["embedding_timeouts"] += 1
                self._timeouts_in_row += 1
        return frame

    def wake_ns(self) -> int | None:
        """Return the monotonic time at which the next frame has waited long enough."""
        return self._due_ns(self._frames[0]) if self._frames else None

    def restart(self, camera: str, stamp_ns: int) -> None:
        """Restart a camera at a stamp after a reset of its clock."""
        self._newest.pop(camera, None)
        self._streams.pop(camera, None)
        self._early = {
            key: e for key, e in self._early.items() if e.camera != camera or e.stamp_ns <= stamp_ns
        }

    def _is_late(self, embeddings: Embeddings) -> bool:
        stream = self._streams.get(embeddings.camera)
        if stream is None or not stream.is_late(embeddings):
            return False
        # Otherwise the first embeddings after a clock reset
        return stream.behind_ns(embeddings) <= JUMP_NS

    def _lacks_embeddings(self, frame: PendingFrame) -> bool:
        detections = frame.detections
        wanted = self._embedding_ns > 0 and len(detections.detections) > 0
        return wanted and detections.crops != 0 and frame.embeddings is None

    def _due_ns(self, frame: PendingFrame) -> int:
        lacks = self._lacks_embeddings(frame) and not self.ignores_embeddings
        wait_ns = self._embedding_ns if lacks else 0
        stream, reorder_ns = self._stream(frame.detections.camera), self._reorder_ns
        if stream.may_lack(frame.detections):
            wait_ns = max(wait_ns, stream.period_ns if reorder_ns is None else reorder_ns)
        # By default frames do not wait for other cameras: late frames are tracked at their time.
        if reorder_ns and self._is_ahead(frame):
            wait_ns = max(wait_ns, reorder_ns)
        return frame.arrived_ns + wait_ns

    def _is_ahead(self, frame: PendingFrame) -> bool:
        """Return True if another camera may still send an earlier frame."""
        return any(
            newest < frame.time_ns and frame.arrived_ns - arrived < ACTIVE_NS
            for camera, (newest, arrived) in self._newest.items()
            if camera != frame.detections.camera
        )

    def _stream(self, camera: str) -> DetectionStream:
        stream = self._streams.pop(camera, None) or DetectionStream()
        self._streams[camera] = stream  # most recently used last
        if len(self._streams) > MAX_CAMERAS:
            del self._streams[next(iter(self._streams))]
        return stream


def _key(message: Detections | Embeddings) -> FrameKey:
    return message.camera, message.stamp_ns, message.sequence
