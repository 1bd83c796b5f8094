"""Pacing of frames: live, as recorded, or in lockstep with the answers."""

from collections import deque

from people4d.errors import ConfigError
from services.camera.config import CameraConfig

MAX_GAP_NS = 10_000_000_000  # [ns] maximum pause in the stamps; longer: a jump of the clock
RATE_NS = 5_000_000_000  # [ns] period over which the rate of a source is measured
FEWEST_FRAMES = 3  # minimum number of frames for a rate
SLOW = 0.8  # minimum rate of a source, relative to the rate of its stamps
MAX_LATE_NS = 1_000_000_000  # [ns] maximum delay that is caught up


class Pacing:
    """Monotonic times at which frames are sent: for a live camera, at once."""

    def due_ns(self, stamp_ns: int, now_ns: int) -> int | None:  # noqa: ARG002
        """Return the time to send the next frame, None if it waits for an answer."""
        return now_ns

    def sent(self, stamp_ns: int, now_ns: int) -> None:
        """Register a sent frame."""

    def answered(self, stamp_ns: int) -> None:
        """Register the answer to a frame."""

    def give_up(self, now_ns: int) -> int:  # noqa: ARG002
        """Drop frames that waited too long for an answer and return their number."""
        return 0

    def wake_ns(self) -> int | None:
        """Return the next deadline for `give_up`, None if no frame waits."""
        return None


class RecordedPacing(Pacing):
    """Frames are sent at the intervals at which they were recorded, divided by the speed."""

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._stamp_ns: int | None = None
        self._due_ns = 0
        self._gap_ns = 0

    def due_ns(self, stamp_ns: int, now_ns: int) -> int | None:
        """Return the last due time plus the interval; over a jump, the previous interval."""
        if self._stamp_ns is None:
            return now_ns
        due_ns = self._due_ns + int(self._gap(stamp_ns) / self._speed)
        return now_ns if now_ns - due_ns > MAX_LATE_NS else due_ns

    def sent(self, stamp_ns: int, now_ns: int) -> None:
        """Continue from the due time of the frame, so delays do not accumulate."""
        due_ns = self.due_ns(stamp_ns, now_ns)
        if self._stamp_ns is not None:
            self._gap_ns = self._gap(stamp_ns)
        self._stamp_ns, self._due_ns = stamp_ns, now_ns if due_ns is None else due_ns

    def _gap(self, stamp_ns: int) -> int:
        gap_ns = stamp_ns - (self._stamp_ns or 0)
        return self._gap_ns if is_jump(gap_ns) else gap_ns


class LockstepPacing(Pacing):
    """Frames as fast as the pipeline answers: `window` unanswered, each for `timeout_ns`."""

    def __init__(self, window: int, timeout_ns: int) -> None:
        self._window = window
        self._timeout_ns = timeout_ns
        self._waiting: dict[int, int] = {}  # deadline by stamp

    def due_ns(self, stamp_ns: int, now_ns: int) -> int | None:
        """Return `now_ns` if the window has room."""
        # Answers to frames of the same stamp could not be distinguished.
        room = len(self._waiting) < self._window and stamp_ns not in self._waiting
        return now_ns if room else None

    def sent(self, stamp_ns: int, now_ns: int) -> None:
        """Expect an answer."""
        self._waiting[stamp_ns] = now_ns + self._timeout_ns

    def answered(self, stamp_ns: int) -> None:
        """Make room in the window; unexpected answers are ignored."""
        self._waiting.pop(stamp_ns, None)

    def give_up(self, now_ns: int) -> int:
        """Drop frames past their deadline."""
        over = [stamp_ns for stamp_ns, end_ns in self._waiting.items() if end_ns <= now_ns]
        for stamp_ns in over:
            del self._waiting[stamp_ns]
        return len(over)

    def wake_ns(self) -> int | None:
        """Return the first deadline."""
        return min(self._waiting.values(), default=None)


class SourceRate:
    """Rate at which a source gives frames, and the rate of their stamps, over some seconds."""

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        self._sent: deque[tuple[int, int]] = deque()  # stamp and time of sending

    def add_frame(self, stamp_ns: int, now_ns: int) -> None:
        """Register a sent frame."""
        if self._sent and is_jump(stamp_ns - self._sent[-1][0]):
            self._sent.clear()
        self._sent.append((stamp_ns, now_ns))
        while len(self._sent) > FEWEST_FRAMES and now_ns - self._sent[1][1] > RATE_NS:
            self._sent.popleft()

    @property
    def hz(self) -> float:
        """Rate of sent frames."""
        return self._rate_hz(1)

    @property
    def wanted_hz(self) -> float:
        """Rate of frames by their stamps, at the speed of playback."""
        return self._rate_hz(0) * self._speed

    @property
    def is_slow(self) -> bool:
        """True if the source delivers clearly fewer frames than its stamps require."""
        long = len(self._sent) > 1 and self._sent[-1][1] - self._sent[0][1] >= RATE_NS
        return long and self.hz < SLOW * self.wanted_hz

    def _rate_hz(self, column: int) -> float:
        length_ns = self._sent[-1][column] - self._sent[0][column] if self._sent else 0
        return 1e9 * (len(self._sent) - 1) / length_ns if length_ns > 0 else 0.0


def is_jump(gap_ns: int) -> bool:
    """Return True for an impossible interval of consecutive frames."""
    return not 0 < gap_ns <= MAX_GAP_NS


def pacing_of(config: CameraConfig, live: bool) -> Pacing:
    """Return the pacing of a playback; ConfigError if the playback does not suit the source."""
    if config.playback not in ("auto", *(("live",) if live else ("recorded", "lockstep"))):
        kind = "live camera" if live else "recording"
        raise ConfigError(
            f"playback: expected another for a {kind}, got {config.playback}", "Leave it on auto."
        )
    if config.playback == "lockstep":
        return LockstepPacing(config.window, int(config.answer_timeout_s * 1e9))
    return Pacing() if live else RecordedPacing(config.speed)
