"""Schedule of predicted tracks after detections stop."""

from collections import Counter, deque
from statistics import median
from typing import NamedTuple

from common.transport.stream_clock import EXTRAPOLATION_MAX_NS
from people4d.messages import Detections, Tracks
from people4d.messages.base import MAX_STAMP_NS
from services.tracker.cameras.frame_join import PendingFrame

QUIET_NS = 200_000_000  # minimum silence of detections before predictions are published [ns]
PERIOD_NS = 100_000_000  # interval of predictions [ns]
SLOW_FACTOR = 3  # minimum silence of stopped detections [frame intervals]


class DuePrediction(NamedTuple):
    """Prediction to be published now."""

    detections: Detections  # last detections
    time_ns: int  # [ns] time of the tracks, in the common time of all cameras
    stamp_ns: int  # [ns] stamp on the clock of the camera of the detections


class PredictionSchedule:
    """Decides when tracks are predicted without a frame.

    Predictions begin QUIET_NS after the last frame, or later if frames are slow, and follow each
    other every PERIOD_NS until EXTRAPOLATION_MAX_NS after it, or until no track is left.

    Attributes:
        counters: Number of people whose prediction ended.
    """

    def __init__(self) -> None:
        self._last: PendingFrame | None = None  # the last frame tracked
        self._intervals_ns: deque[int] = deque(maxlen=9)
        self._published = 0  # number of tracks in the last message
        self.counters = Counter(people_unknown=0)
        self.wake_ns: int | None = None  # [ns] arrival time at which the next prediction is due

    def time_ns(self, now_ns: int) -> int | None:
        """Return the time of frames that arrive now; None before the first frame."""
        last = self._last
        return None if last is None else last.time_ns + now_ns - last.arrived_ns

    def record(self, frame: PendingFrame, tracks: Tracks) -> None:
        """Record the tracks of a frame."""
        self._published = len(tracks.tracks)
        if self._last:
            self._intervals_ns.append(frame.arrived_ns - self._last.arrived_ns)
        self._last = frame
        # Playback slower than real time is no outage: slow frames allow a longer silence.
        period_ns = median(self._intervals_ns) if self._intervals_ns else 0
        quiet_ns = max(QUIET_NS, SLOW_FACTOR * period_ns)
        self.wake_ns = frame.arrived_ns + int(quiet_ns)

    def due(self, now_ns: int) -> DuePrediction | None:
        """Return the prediction that is due; None otherwise, and beyond the range of stamps."""
        last, time_ns = self._last, self.time_ns(now_ns)
        if last is None or time_ns is None or self.wake_ns is None or now_ns < self.wake_ns:
            return None
        stamp_ns = last.detections.stamp_ns + now_ns - last.arrived_ns
        if max(time_ns, stamp_ns) > MAX_STAMP_NS:
            self.wake_ns = None
            return None
        return DuePrediction(last.detections, time_ns, stamp_ns)

    def ends(self, now_ns: int) -> bool:
        """Check that predictions have ended, and count the people whose prediction ends."""
        ended = self._last is not None and now_ns - self._last.arrived_ns > EXTRAPOLATION_MAX_NS
        self.counters["people_unknown"] += self._published if ended else 0
        return ended

    def publishes(self, tracks: Tracks, now_ns: int) -> bool:
        """Return True if predicted tracks are published: after the last one an empty message."""
        before, self._published = self._published, len(tracks.tracks)
        self.wake_ns = now_ns + PERIOD_NS if tracks.tracks else None
        return bool(before or tracks.tracks)

    def clear(self) -> None:
        """Delete all frames."""
        self._last = self.wake_ns = None
        self._intervals_ns.clear()
