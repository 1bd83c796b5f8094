"""Detections wait for the embeddings of their frame, and for their turn."""

from collections import Counter
from dataclasses import dataclass

from people4d.messages import Detections, Embeddings
from services.tracker.stream import Stream

ACTIVE_NS = 1_000_000_000
EARLY_MAX = 256
COUNTERS = (
    *("embedding_timeouts", "without_embeddings", "late_embeddings"),
    *("duplicates", "stale", "missing"),
)


@dataclass(slots=True)
class Frame:
    """Detections that wait."""

    detections: Detections
    arrived_ns: int  # [ns] monotonic
    embeddings: Embeddings | None = None


@dataclass(frozen=True, slots=True)
class Patience:
    """How long frames wait.

    Args:
        embedding_ns: Longest wait for embeddings; 0 if the tracker uses none.
        embedding_frames: Frames waited for in vain after which waiting stops, until embeddings
            come again: a dead re-identification must not delay every frame.
        reorder_ns: Longest wait for frames of other cameras, and for earlier ones of this camera
            that another detector does; None: as long as from one frame to the next.
    """

    embedding_ns: int
    embedding_frames: int
    reorder_ns: int | None


class Join:
    """Gives frames out by stamp, with their embeddings where these came in time."""

    def __init__(self, patience: Patience) -> None:
        self.counters = Counter(dict.fromkeys(COUNTERS, 0))
        self._patience = patience
        self._frames: list[Frame] = []
        self._early: dict[tuple[str, int], Embeddings] = {}
        self._heard: dict[str, tuple[int, int]] = {}  # camera: newest stamp, monotonic arrival
        self._streams: dict[str, Stream] = {}
        self._in_vain = 0

    @property
    def silent(self) -> bool:
        """Whether embeddings are no longer waited for."""
        return self._in_vain >= self._patience.embedding_frames

    @property
    def waiting(self) -> bool:
        """Whether a frame waits."""
        return bool(self._frames)

    def newest_ns(self, camera: str) -> int | None:
        """Return the newest stamp heard of a camera."""
        heard = self._heard.get(camera)
        return heard[0] if heard else None

    def add_detections(self, detections: Detections, now_ns: int, late: bool = False) -> None:
        """Let a frame wait; one that is here twice or too late is counted, not used.

        Args:
            detections: The frame's detections.
            now_ns: Monotonic time.
            late: Whether the tracker has gone past their stamp already.
        """
        key = (detections.camera, detections.stamp_ns)
        stream = self._stream(detections)
        stream.came(detections)
        if stream.was_given(detections) or any(_key(frame) == key for frame in self._frames):
            self.counters["duplicates"] += 1
            return
        if late:
            self.counters["stale"] += 1
            return
        newest = self.newest_ns(detections.camera)
        newest = detections.stamp_ns if newest is None else max(newest, detections.stamp_ns)
        self._heard[detections.camera] = newest, now_ns
        self._frames.append(Frame(detections, now_ns, self._early.pop(key, None)))
        self._frames.sort(key=lambda frame: (frame.detections.stamp_ns, frame.detections.camera))

    def add_embeddings(self, embeddings: Embeddings, late: bool) -> None:
        """Give embeddings to their frame, or keep them for a frame that has yet to come.

        Args:
            embeddings: The embeddings.
            late: Whether the tracker has gone past their stamp already.
        """
        self._in_vain = 0
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

    def pop(self, now_ns: int, flush: bool = False) -> Frame | None:
        """Take the next frame if it need not wait any longer.

        Args:
            now_ns: Monotonic time.
            flush: Take it in any case.
        """
        if not self._frames:
            return None
        frame = self._frames[0]
        if not flush and now_ns < self._due_ns(frame):
            return None
        del self._frames[0]
        self.counters["missing"] += self._stream(frame.detections).gives(frame.detections)
        if self._lacks_embeddings(frame):
            self.counters["without_embeddings"] += 1
            if not self.silent:
                self.counters["embedding_timeouts"] += 1
                self._in_vain += 1
        return frame

    def wake_ns(self) -> int | None:
        """Return the monotonic time at which the next frame has waited long enough."""
        return self._due_ns(self._frames[0]) if self._frames else None

    def restart(self, stamp_ns: int) -> None:
        """Begin a new time at a stamp: forget what was heard after it."""
        self._heard.clear()
        self._streams.clear()
        self._early = {key: e for key, e in self._early.items() if e.stamp_ns <= stamp_ns}

    def _lacks_embeddings(self, frame: Frame) -> bool:
        wanted = self._patience.embedding_ns > 0 and len(frame.detections.detections) > 0
        return wanted and frame.embeddings is None

    def _due_ns(self, frame: Frame) -> int:
        lacks = self._lacks_embeddings(frame) and not self.silent
        wait_ns = self._patience.embedding_ns if lacks else 0
        stream = self._stream(frame.detections)
        if self._is_ahead(frame) or stream.may_lack(frame.detections):
            reorder_ns = self._patience.reorder_ns
            wait_ns = max(wait_ns, stream.period_ns if reorder_ns is None else reorder_ns)
        return frame.arrived_ns + wait_ns

    def _is_ahead(self, frame: Frame) -> bool:
        """Return whether another camera may still send something earlier."""
        return any(
            newest < frame.detections.stamp_ns and frame.arrived_ns - arrived < ACTIVE_NS
            for camera, (newest, arrived) in self._heard.items()
            if camera != frame.detections.camera
        )

    def _stream(self, detections: Detections) -> Stream:
        return self._streams.setdefault(detections.camera, Stream())


def _key(frame: Frame) -> tuple[str, int]:
    return frame.detections.camera, frame.detections.stamp_ns
