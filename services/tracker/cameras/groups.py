"""Trackers of cameras by their clocks: one of all that agree, one of each camera apart."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

from people4d.messages import Detections, ImageTrack, Track
from services.tracker.cameras.clocks import OFFSET_MAX_NS, CameraClocks
from services.tracker.cameras.drift import CameraDrift
from services.tracker.config import TrackerConfig
from services.tracker.interface import Observation, Tracker
from services.tracker.motion.past_frames import LENGTH_NS

STAMP_MIN_S, STAMP_SIGMAS = 0.015, 3.0  # errors of a camera's stamps that are corrected first,
AGAIN_MIN_S, AGAIN_SIGMAS = 0.005, 1.0  # and later: its stamps are wrong, but by how much exactly
ABSENCE_MOVED_S = 1.0  # longest time for which people move during an absence of frames [s]
APART_MAX = 4  # most cameras tracked apart
APART_NS = 10_000_000_000  # silence after which a camera apart is removed [ns]
COUNTERS = ("late_frames", "tracker_failures", "refused_cameras", "apart")


@dataclass(slots=True)
class ApartTracker:
    """Tracker of a camera whose clock is too far from the other clocks."""

    tracker: Tracker
    last_ns: int  # [ns] time of its last frame
    arrived_ns: int  # [ns] monotonic arrival of that


class ClockGroups:
    """Trackers that get frames in the common time of all cameras, see CameraClocks.

    Args:
        config: Configuration of the service.
        make_tracker: Makes a tracker.
    """

    def __init__(self, config: TrackerConfig, make_tracker: Callable[[], Tracker]) -> None:
        self._config, self._make_tracker = config, make_tracker
        self.main = make_tracker()
        self.clocks = CameraClocks()
        self.counters = Counter(dict.fromkeys(COUNTERS, 0))
        self._apart: dict[str, ApartTracker] = {}  # by camera
        self._last_ns: int | None = None  # [ns] time of the last frame of the main tracker
        self._is_restored = False  # that frame was tracked by another process

    @property
    def last_ns(self) -> int | None:
        """Time of the last frame of the main tracker, by this process or the one before."""
        return self._last_ns

    def is_apart(self, camera: str) -> bool:
        """Check that a camera has a tracker of its own."""
        return camera in self._apart

    def is_reset(self, detections: Detections) -> bool:
        """Check that the clock of a camera went back by more than a late frame explains."""
        newest_ns = self.clocks.newest_ns(detections.camera)
        jump_ns = self._config.clock_jump_s * 1e9
        return newest_ns is not None and newest_ns - detections.stamp_ns > jump_ns

    def restart(self, camera: str, now_ns: int) -> bool:
        """Restart after a clock reset of a camera; return False if others go on."""
        self._apart.pop(camera, None)
        if self.clocks.restart(camera, now_ns):
            return False
        self.main.reset()
        self._last_ns = None
        return True

    def restore(self, offsets_ns: dict[str, int], time_ns: int) -> None:
        """Continue at the time of a checkpoint, with its offsets of clocks."""
        self.clocks.restore(offsets_ns, time_ns)
        self._last_ns, self._is_restored = time_ns, True

    def reset(self) -> None:
        """Delete all tracks."""
        self.main.reset()
        self._apart.clear()

    def is_late(self, camera: str, time_ns: int) -> bool:
        """Check that a frame comes too late to be tracked at the time of the last one."""
        apart, last_ns = self._apart.get(camera), self._last_ns
        last_ns = apart.last_ns if apart else last_ns
        # The process before may have tracked an earlier frame.
        late_ns = 0 if self._is_restored and not apart else LENGTH_NS
        return last_ns is not None and time_ns < last_ns - late_ns

    def correct_stamps(self, watch: CameraDrift, time_ns: int) -> None:
        """Correct the stamps of cameras that differ by the people before two of them."""
        clocks = self.clocks
        while clocks.corrected:
            watch.forget(clocks.corrected.pop())
        for camera, error in watch.stamp_errors(clocks.reference, time_ns).items():
            least_s, sigmas = STAMP_MIN_S, STAMP_SIGMAS
            if clocks.is_adjusted(camera):
                least_s, sigmas = AGAIN_MIN_S, AGAIN_SIGMAS
            ahead_ns = round(error.ahead_s * 1e9)
            is_significant = abs(error.ahead_s) > max(least_s, sigmas * error.sigma_s)
            if is_significant and clocks.adjust(camera, ahead_ns):
                watch.restamp(camera, ahead_ns)

    def update(self, observation: Observation, now_ns: int) -> list[Track] | None:
        """Track a frame whose stamp is in the common time; None if too many cameras are apart."""
        if self.clocks.is_apart(observation.camera):
            return self._update_apart(observation, now_ns)
        self._apart.pop(observation.camera, None)
        time_ns, last_ns = observation.stamp_ns, self._last_ns
        try:
            if last_ns is not None and time_ns < last_ns:
                self.counters["late_frames"] += 1
                return self.main.update_late(observation, last_ns)
            if last_ns is not None:
                self._bridge_absence(time_ns - last_ns)
            self._last_ns, self._is_restored = time_ns, False
            return self.main.update(observation)
        except Exception:  # a state that fails once fails at every frame
            self.counters["tracker_failures"] += 1
            self.main.reset()
            raise

    def predict(self, time_ns: int) -> list[Track]:
        """Return the tracks of the main tracker at a later time."""
        return self.main.predict(max(time_ns, self._last_ns or time_ns))

    def image_tracks(self, camera: str) -> tuple[ImageTrack, ...] | None:
        """Return the tracks in the image of the last frame of a camera; None: there are none."""
        apart = self._apart.get(camera)
        return (apart.tracker if apart else self.main).image_tracks()

    def gauges(self, now_ns: int) -> dict[str, float]:
        """Return offsets of clocks and delays of messages [ms] by name, of two or more cameras."""
        offsets_ms, delays_ms = self.clocks.offsets_ms(now_ns), self.clocks.delays_ms(now_ns)
        if len(offsets_ms) < 2:
            return {}
        offsets = {f"camera_offset_{camera}_ms": ms for camera, ms in offsets_ms.items()}
        return offsets | {f"camera_delay_{camera}_ms": ms for camera, ms in delays_ms.items()}

    def reasons(self, now_ns: int) -> list[str]:
        """Return a sentence on each active camera whose clock is too far from the others'."""
        limit_s, reference = OFFSET_MAX_NS / 1e9, self.clocks.reference
        offsets_ms = self.clocks.offsets_ms(now_ns)
        found = [(c, ms / 1e3) for c, ms in offsets_ms.items() if self.clocks.is_apart(c)]
        return [
            f"the clock of camera {camera} is {abs(ahead_s):.1f} s "
            f"{'ahead of' if ahead_s > 0 else 'behind'} that of {reference}, more than "
            f"{limit_s:g} s: it is tracked apart"
            for camera, ahead_s in found[:APART_MAX]
        ]

    def _update_apart(self, observation: Observation, now_ns: int) -> list[Track] | None:
        camera, ids = observation.camera, self.main.ids
        self._apart = {c: a for c, a in self._apart.items() if now_ns - a.arrived_ns < APART_NS}
        if camera not in self._apart:
            if len(self._apart) >= APART_MAX:
                self.counters["refused_cameras"] += 1
                return None
            self._apart[camera] = ApartTracker(self._make_tracker(), observation.stamp_ns, now_ns)
        apart = self._apart[camera]
        apart.last_ns, apart.arrived_ns = max(observation.stamp_ns, apart.last_ns), now_ns
        if ids and apart.tracker.ids:  # an identity is given once
            apart.tracker.ids.raise_to(ids.next)
        try:
            tracks = apart.tracker.update(replace(observation, stamp_ns=apart.last_ns))
        except Exception:
            self.counters["tracker_failures"] += 1
            del self._apart[camera]
            raise
        if ids and apart.tracker.ids:
            ids.raise_to(apart.tracker.ids.next)
        self.counters["apart"] += 1
        return tracks

    def _bridge_absence(self, absent_ns: int) -> None:
        """Skip most of a time in which no frame came, or this service did not run.

        After a short one people are found where they were going, after a long one where they were.
        """
        config, absent_s = self._config, absent_ns / 1e9
        if config.max_lost_s < absent_s <= config.absence_max_s:
            self.main.postpone(int((absent_s - ABSENCE_MOVED_S) * 1e9))
