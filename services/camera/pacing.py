"""When the next frame may go out."""

from typing import Protocol

MAX_GAP_NS = 10_000_000_000  # a longer pause in the stamps is a jump of the clock
MAX_LATE_NS = 1_000_000_000  # further behind, lost time is not made good


class Pacing(Protocol):
    """Decides when frames go out; all times are monotonic, all stamps the frames' own."""

    def due_ns(self, stamp_ns: int, now_ns: int) -> int | None:
        """Return when the next frame may go, None if that depends on an answer."""
        ...

    def sent(self, stamp_ns: int, now_ns: int) -> None:
        """Note that the frame went out."""
        ...

    def answered(self, stamp_ns: int) -> None:
        """Note that a frame was answered."""
        ...

    def give_up(self, now_ns: int) -> int:
        """Forget frames that waited too long for an answer and return how many."""
        ...

    def wake_ns(self) -> int | None:
        """Return when `give_up` is wanted, None while nothing waits."""
        ...


class LivePacing:
    """A live camera paces itself."""

    def due_ns(self, stamp_ns: int, now_ns: int) -> int | None:  # noqa: ARG002
        """Return now."""
        return now_ns

    def sent(self, stamp_ns: int, now_ns: int) -> None:
        """Note nothing."""

    def answered(self, stamp_ns: int) -> None:
        """Need no answers."""

    def give_up(self, now_ns: int) -> int:  # noqa: ARG002
        """Wait for nothing."""
        return 0

    def wake_ns(self) -> int | None:
        """Wait for nothing."""
        return None


class RecordedPacing(LivePacing):
    """The distances in time at which frames were recorded.

    Args:
        speed: 2 plays twice as fast.
    """

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._stamp_ns: int | None = None
        self._due_ns = 0
        self._gap_ns = 0

    def due_ns(self, stamp_ns: int, now_ns: int) -> int | None:
        """Return the due time of the last frame and the gap; over a jump the gap before it."""
        if self._stamp_ns is None:
            return now_ns
        due_ns = self._due_ns + int(self._gap(stamp_ns) / self._speed)
        return now_ns if now_ns - due_ns > MAX_LATE_NS else due_ns

    def sent(self, stamp_ns: int, now_ns: int) -> None:
        """Count on from when the frame was due, so that delays do not add up."""
        due_ns = self.due_ns(stamp_ns, now_ns)
        if self._stamp_ns is not None:
            self._gap_ns = self._gap(stamp_ns)
        self._stamp_ns, self._due_ns = stamp_ns, now_ns if due_ns is None else due_ns

    def _gap(self, stamp_ns: int) -> int:
        gap_ns = stamp_ns - (self._stamp_ns or 0)
        return self._gap_ns if is_jump(gap_ns) else gap_ns


class LockstepPacing:
    """As fast as the pipeline goes: a frame goes out when few enough are unanswered.

    Args:
        window: Frames that may be unanswered.
        timeout_ns: Time after which a frame is given up.
    """

    def __init__(self, window: int, timeout_ns: int) -> None:
        self._window = window
        self._timeout_ns = timeout_ns
        self._waiting: dict[int, int] = {}  # deadline by stamp

    def due_ns(self, stamp_ns: int, now_ns: int) -> int | None:
        """Return now while there is room in the window."""
        # Frames with one and the same stamp could not be told apart in their answers.
        room = len(self._waiting) < self._window and stamp_ns not in self._waiting
        return now_ns if room else None

    def sent(self, stamp_ns: int, now_ns: int) -> None:
        """Wait for the answer."""
        self._waiting[stamp_ns] = now_ns + self._timeout_ns

    def answered(self, stamp_ns: int) -> None:
        """Make room; an answer to nothing that waits is ignored."""
        self._waiting.pop(stamp_ns, None)

    def give_up(self, now_ns: int) -> int:
        """Forget frames whose time is over."""
        over = [stamp_ns for stamp_ns, end_ns in self._waiting.items() if end_ns <= now_ns]
        for stamp_ns in over:
            del self._waiting[stamp_ns]
        return len(over)

    def wake_ns(self) -> int | None:
        """Return the first deadline."""
        return min(self._waiting.values(), default=None)


def is_jump(gap_ns: int) -> bool:
    """Tell whether stamps that far apart cannot be those of two frames in a row."""
    return not 0 < gap_ns <= MAX_GAP_NS
