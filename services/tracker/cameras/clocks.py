"""Offsets between the clocks of cameras, by the arrival of their frames and by people in view.

The time from the stamp of a frame to its arrival, less the stages in its trace, is the offset of
two clocks plus a delay >= 0. Its minimum over some seconds changes only with the clock or with the
path of the messages. The difference of the minima of two cameras is the offset of their clocks plus
the difference of their minimum delays. A large difference counts as an offset of the clocks. For
smaller ones, people in view of both cameras show the offset (see `adjust`).
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from people4d.messages import Detections, Span
from people4d.messages.base import MAX_CAMERAS
from services.tracker.cameras.drift import CameraDrift

# Difference of delays above which the clock of a camera is corrected by arrival alone [ns]
TOLERANCE_NS = 350_000_000
HALF_WINDOW_NS = 5_000_000_000  # half of the window of the minimum delay [ns]
DELAY_MAX_NS = 900_000_000  # maximum plausible difference of two delays [ns]
RISE_NS = 250_000_000  # minimum rise of the least delay after a clock was set back [ns]
RISEN_MAX = 10  # maximum number of consecutive frames with a rise before the minimum restarts
TRACE_MAX_NS = 2_000_000_000  # maximum sum of the stages in a trace [ns]
ACTIVE_NS = 3_000_000_000  # maximum silence of an active camera [ns]
INTERVALS = 9  # stored intervals between frames of a camera
REFERENCE_NS = 30_000_000_000  # maximum silence of the reference camera [ns]
# Minimum corrected error of stamps [s] and [standard deviations]: first and later corrections
FIRST_MIN_S, FIRST_SIGMAS = 0.015, 3.0
LATER_MIN_S, LATER_SIGMAS = 0.005, 1.0


class LeastDelay:
    """Minimum delay over the last 5 to 10 seconds."""

    def __init__(self) -> None:
        self.frames = 0
        self._least_ns: int | None = None
        self._before_ns: int | None = None  # minimum of the previous half window
        self._since_ns = 0
        self._risen = 0

    @property
    def ns(self) -> int:
        """The minimum delay; 0 before the first frame."""
        found = [ns for ns in (self._least_ns, self._before_ns) if ns is not None]
        return min(found, default=0)

    @property
    def rises(self) -> bool:
        """True if the last delays exceed all earlier ones: the clock may be set back."""
        return self._risen > 0

    def add_delay(self, delay_ns: int, now_ns: int) -> None:
        """Add the delay of a frame."""
        self.frames += 1
        self._risen = self._risen + 1 if self.frames > 1 and delay_ns > self.ns + RISE_NS else 0
        if self._least_ns is None or self._risen >= RISEN_MAX:
            self._least_ns, self._before_ns = delay_ns, None
            self._since_ns, self._risen = now_ns, 0
        elif now_ns - self._since_ns > HALF_WINDOW_NS:
            self._before_ns, self._least_ns, self._since_ns = self._least_ns, delay_ns, now_ns
        else:
            self._least_ns = min(self._least_ns, delay_ns)


@dataclass(slots=True)
class CameraClock:
    """The clock of one camera."""

    offset_ns: int  # [ns] offset subtracted from its stamps
    delay_ns: int = 0  # [ns] delay of its messages, relative to the reference
    newest_ns: int = 0  # [ns] newest stamp
    heard_ns: int = 0  # [ns] monotonic
    delay: LeastDelay = field(default_factory=LeastDelay)
    intervals_ns: deque[int] = field(default_factory=lambda: deque(maxlen=INTERVALS))


class CameraClocks:
    """Corrections of stamps to the time of the reference camera.

    The first camera is the reference. The offset of a camera changes if its frames arrive earlier
    or later than predicted by more than TOLERANCE_NS, and by `adjust`.
    """

    def __init__(self) -> None:
        self._clocks: dict[str, CameraClock] = {}
        self._restored: dict[str, int] = {}  # offsets of a checkpoint [ns]
        self._restored_ns: int | None = None  # newest stamp of its reference
        self.reference = ""  # name of the camera; empty before the first frame
        self.corrected: set[str] = set()  # cameras whose offset was changed by arrival times
        self._reference_ns = 0  # [ns] monotonic arrival of the last frame of the reference

    @property
    def has_several(self) -> bool:
        """True if two or more cameras send frames."""
        return len(self._clocks) > 1

    def add_detections(self, detections: Detections, now_ns: int) -> int | None:
        """Return the common time of detections that arrive now [ns]; None beyond MAX_CAMERAS."""
        camera, stamp_ns = detections.camera, detections.stamp_ns
        clock = self._clocks.get(camera) or self._begin(camera, now_ns)
        if clock is None:
            return None
        is_first = clock.delay.frames == 0
        clock.newest_ns = stamp_ns if is_first else max(clock.newest_ns, stamp_ns)
        if not is_first:
            clock.intervals_ns.append(now_ns - clock.heard_ns)
        clock.heard_ns = now_ns
        clock.delay.add_delay(now_ns - _measured_ns(detections.trace) - stamp_ns, now_ns)
        self._choose_reference(camera, now_ns)
        self._correct(camera, clock)
        return stamp_ns - clock.offset_ns

    def newest_ns(self, camera: str) -> int | None:
        """Return the newest stamp of a camera; None before the first."""
        clock = self._clocks.get(camera)
        if clock is None:
            return self._restored_ns if camera == self.reference else None
        return clock.newest_ns

    def elapsed_ns(self, camera: str, now_ns: int) -> int | None:
        """Return the time since the last frame of a camera [ns]; None before the first."""
        clock = self._clocks.get(camera)
        return None if clock is None else max(now_ns - clock.heard_ns, 0)

    def interval_ns(self, camera: str) -> int:
        """Return the longest time between the last frames of a camera [ns]; 0 before the second."""
        clock = self._clocks.get(camera)
        return max(clock.intervals_ns, default=0) if clock else 0

    def restart(self, camera: str, now_ns: int) -> bool:
        """Delete the clock of a camera; return True if other cameras continue."""
        others = [
            name
            for name, clock in self._clocks.items()
            if name != camera and now_ns - clock.heard_ns < ACTIVE_NS
        ]
        self._clocks.pop(camera, None)
        self._restored.pop(camera, None)
        if camera == self.reference:
            self._restored_ns = None
        if camera == self.reference and others:
            self.reference = others[0]
        return bool(others)

    def correct_stamps(self, watch: CameraDrift, time_ns: int) -> None:
        """Correct stamps of cameras by the positions of people in view of two cameras."""
        while self.corrected:
            watch.forget(self.corrected.pop())
        for camera, error in watch.stamp_errors(self.reference, time_ns).items():
            clock = self._clocks.get(camera)
            least_s, sigmas = FIRST_MIN_S, FIRST_SIGMAS
            if clock is not None and clock.delay_ns:  # the stamps of this clock are wrong
                least_s, sigmas = LATER_MIN_S, LATER_SIGMAS
            ahead_ns = round(error.ahead_s * 1e9)
            is_significant = abs(error.ahead_s) > max(least_s, sigmas * error.sigma_s)
            if is_significant and self.adjust(camera, ahead_ns):
                watch.restamp(camera, ahead_ns)

    def adjust(self, camera: str, ahead_ns: int) -> bool:
        """Correct the stamps of a camera by the motion of people; return False if implausible.

        Args:
            camera: Name of the camera.
            ahead_ns: Error of its corrected stamps relative to the reference.
        """
        clock, reference = self._clocks.get(camera), self._clocks.get(self.reference)
        if clock is None or reference is None or camera == self.reference:
            return False
        if clock.delay.rises or reference.delay.rises:
            return False
        offset_ns = clock.offset_ns + ahead_ns
        delay_ns = offset_ns - reference.offset_ns - self._measured_ahead_ns(camera)
        if abs(delay_ns) > DELAY_MAX_NS:
            return False
        clock.offset_ns, clock.delay_ns = offset_ns, delay_ns
        return True

    def gauges(self, now_ns: int) -> dict[str, float]:
        """Return offsets and delays of active cameras against the reference, if several [ms]."""
        active = [c for c, clock in self._clocks.items() if now_ns - clock.heard_ns < ACTIVE_NS]
        if len(active) < 2:
            return {}
        offsets_ns = {camera: self._ahead_ns(camera) for camera in active}
        delays_ns = {c: offsets_ns[c] - self._measured_ahead_ns(c) for c in active}
        offsets_ms = {f"camera_offset_{c}_ms": ns / 1e6 for c, ns in offsets_ns.items()}
        return offsets_ms | {f"camera_delay_{c}_ms": ns / 1e6 for c, ns in delays_ns.items()}

    def save(self) -> dict[str, int]:
        """Return the offsets [ns] by camera, the reference first."""
        cameras = sorted(self._clocks, key=lambda camera: camera != self.reference)
        return {camera: self._clocks[camera].offset_ns for camera in cameras}

    def restore(self, offsets_ns: dict[str, int], time_ns: int) -> None:
        """Continue with the offsets and the time of a checkpoint."""
        self._restored = dict(offsets_ns)
        self.reference, offset_ns = next(iter(offsets_ns.items()), ("", 0))
        self._restored_ns = time_ns + offset_ns

    def _begin(self, camera: str, now_ns: int) -> CameraClock | None:
        if len(self._clocks) >= MAX_CAMERAS:
            oldest = min(self._clocks, key=lambda name: self._clocks[name].heard_ns)
            # A new camera never evicts an active one.
            if now_ns - self._clocks[oldest].heard_ns < ACTIVE_NS:
                return None
            del self._clocks[oldest]
        clock = CameraClock(self._restored.get(camera, 0))
        self._clocks[camera] = clock
        return clock

    def _choose_reference(self, camera: str, now_ns: int) -> None:
        if not self._reference_ns:
            self._reference_ns = now_ns
        if not self.reference or now_ns - self._reference_ns > REFERENCE_NS:
            self.reference = camera
        if camera == self.reference:
            self._reference_ns = now_ns

    def _correct(self, camera: str, clock: CameraClock) -> None:
        reference = self._clocks.get(self.reference)
        if reference is None or camera == self.reference:
            return
        offset_ns = reference.offset_ns + self._measured_ahead_ns(camera) + clock.delay_ns
        if abs(offset_ns - clock.offset_ns) > TOLERANCE_NS:
            clock.offset_ns = offset_ns
            self.corrected.add(camera)

    def _measured_ahead_ns(self, camera: str) -> int:
        """Return the measured offset of a clock against the reference [ns]."""
        reference = self._clocks.get(self.reference)
        return reference.delay.ns - self._clocks[camera].delay.ns if reference else 0

    def _ahead_ns(self, camera: str) -> int:
        """Return the corrected offset of a clock against the reference [ns]."""
        clock, reference = self._clocks.get(camera), self._clocks.get(self.reference)
        return clock.offset_ns - reference.offset_ns if clock and reference else 0


def _measured_ns(trace: Sequence[Span]) -> int:
    """Return the duration of all stages in a trace but the capture, on the camera's clock."""
    spans = (span for span in trace if not span.stage.endswith(".capture"))
    return min(max(sum(span.end_ns - span.start_ns for span in spans), 0), TRACE_MAX_NS)
