"""Detection of cameras that are silent, or miss people detected by other cameras.

Source: docs/method.md, section 28. Tracks are not changed.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from common.geometry.transforms import apply
from common.text import NAMES_MAX, named
from people4d.messages import Track
from people4d.messages.base import MAX_CAMERAS
from services.tracker.interface import Observation

# Time [ns] and number of frames after which a camera is silent
SILENT_NS, SILENT_FRAMES = 3_000_000_000, 10
FORGOTTEN_NS = 600_000_000_000  # maximum silence of a reported camera [ns]
SAMPLE_NS, WINDOW_NS = 200_000_000, 10_000_000_000  # interval and window of samples [ns]
NEAR_M, FAR_M = 0.8, 5.0  # range of depth in which detections are expected [m]
INSIDE = 0.8  # central part of the image's width in which detections are expected
FRESH_S = 0.3  # maximum time since the last match of a track [s]
EXPECTED_MIN = 25  # minimum number of expected detections in the window for a covered camera
# Minimum number of expected detections before the window, and minimum share of found ones
USUAL_MIN, USUAL_SHARE = 50, 0.5


@dataclass(slots=True)
class _Camera:
    """Samples of one camera."""

    arrived_ns: int  # [ns] monotonic arrival of the last frame
    interval_ns: int = 0  # [ns] maximum recent interval between frames
    sampled_ns: int | None = None  # [ns] stamp of the last sample
    samples: deque[tuple[int, int, int]] = field(default_factory=deque)  # stamp, expected, found
    expected: int = 0  # number of expected people, over all samples before the window
    found: int = 0  # number of found people, over all samples before the window

    def add_sample(self, stamp_ns: int, expected: int, found: int) -> None:
        """Add a sample."""
        self.sampled_ns = stamp_ns
        self.samples.append((stamp_ns, expected, min(expected, found)))
        while self.samples and stamp_ns - self.samples[0][0] > WINDOW_NS:
            _, expected, found = self.samples.popleft()
            if not self.is_covered:  # a failure must not become the usual share
                self.expected, self.found = self.expected + expected, self.found + found

    @property
    def is_covered(self) -> bool:
        """True if all expected detections are missing, while most were found before."""
        expected = sum(sample[1] for sample in self.samples)
        usual = self.expected >= USUAL_MIN and self.found >= USUAL_SHARE * self.expected
        return usual and expected >= EXPECTED_MIN and not any(s[2] for s in self.samples)


class CameraAbsence:
    """Compares the detections of each camera with the tracks of all cameras."""

    def __init__(self) -> None:
        self._cameras: dict[str, _Camera] = {}

    def clear(self) -> None:
        """Delete the samples, after transforms changed."""
        for camera in self._cameras.values():
            camera.samples.clear()
            camera.sampled_ns = None

    def add_frame(self, observation: Observation, tracks: Sequence[Track], arrived_ns: int) -> None:
        """Add a frame and the tracks after it."""
        name, stamp_ns = observation.camera, observation.stamp_ns
        if name not in self._cameras and len(self._cameras) >= MAX_CAMERAS:
            return
        camera = self._cameras.setdefault(name, _Camera(arrived_ns))
        camera.interval_ns = max(arrived_ns - camera.arrived_ns, camera.interval_ns * 9 // 10)
        camera.arrived_ns = arrived_ns
        if len(self._cameras) < 2:
            return
        if camera.sampled_ns is None or not 0 <= stamp_ns - camera.sampled_ns < SAMPLE_NS:
            camera.add_sample(
                stamp_ns, _expected(observation, tracks), len(observation.measurements)
            )

    def reasons(self, now_ns: int) -> list[str]:
        """Return a status message for each silent or covered camera, if other cameras work."""
        ages_ns = {
            name: age_ns
            for name, camera in self._cameras.items()
            if (age_ns := now_ns - camera.arrived_ns) < FORGOTTEN_NS
        }
        silent = [
            name
            for name, age_ns in ages_ns.items()
            if age_ns > max(SILENT_NS, SILENT_FRAMES * self._cameras[name].interval_ns)
        ]
        reasons = []
        if silent and len(silent) < len(ages_ns):
            reasons.append(
                f"no detections arrive from {named('camera', silent)}, while others send"
            )
        covered = [n for n in ages_ns if n not in silent and self._cameras[n].is_covered]
        reasons += [
            f"camera {name} detects no person in its view: is it covered?"
            for name in covered[:NAMES_MAX]
        ]
        return reasons


def _expected(observation: Observation, tracks: Sequence[Track]) -> int:
    """Return the number of tracks well inside the image and range of a camera."""
    if observation.camera_from_map is None or observation.edges is None:
        return 0
    positions = [t.position_m for t in tracks if t.time_since_update_s < FRESH_S]
    points = apply(observation.camera_from_map, np.reshape(positions, (-1, 3)))
    points = points[(points[:, 2] > NEAR_M) & (points[:, 2] < FAR_M)]
    left, right = INSIDE * observation.edges.left, INSIDE * observation.edges.right
    across = points[:, 0] / points[:, 2]
    return int(np.sum((across > left) & (across < right)))
