"""Guard against frames whose stamps are far from the clock of their camera.

Without authentication any client can publish as a camera. Messages with a distant stamp must not
end tracks while the camera itself continues. After a clock change or a restarted recording, frames
with the previous clock stop.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from people4d.messages import Detections
from services.tracker.cameras.clocks import CameraClocks

JUMP_NS = 1_000_000_000  # minimum jump of a clock: frames with such stamps are held [ns]
# minimum silence of the previous clock before a jump is accepted [ns]
SILENT_NS = 1_000_000_000
SILENT_INTERVALS = 3  # minimum silence of slow cameras [longest interval between frames]
SILENT_MAX_NS = 4_000_000_000  # maximum silence required [ns]
CAMERAS_MAX = 8  # maximum number of cameras with held frames
HELD_MAX = 64  # maximum number of held frames of a camera; the second oldest is dropped
HELD_MAX_BYTES = 16 * 2**20  # maximum total size of held frames [bytes]
PERSON_BYTES = 2000  # size of a detection without its mask [bytes]
REPORTED_NS = 10_000_000_000  # time for which dropped frames degrade the status [ns]


@dataclass(slots=True)
class ArrivedFrame:
    """Detections with their time of arrival."""

    detections: Detections
    arrived_ns: int  # [ns] monotonic arrival
    size_bytes: int = 0  # approximate size of a held frame


@dataclass(slots=True)
class StampGuard:
    """Admits frames near the clock of their camera; holds others until that clock is silent.

    Args:
        clocks: Clocks of all cameras.
    """

    clocks: CameraClocks
    counters: Counter[str] = field(default_factory=lambda: Counter(stray_frames=0))
    _held: dict[str, list[ArrivedFrame]] = field(default_factory=dict)  # held frames by camera
    # Time of the drop [ns] and offset [s], by camera
    _strays: dict[str, tuple[int, float]] = field(default_factory=dict)

    def admit(self, detections: Detections, now_ns: int) -> list[ArrivedFrame]:
        """Return a frame that is to be tracked now; `due` returns held frames."""
        camera, frame = detections.camera, ArrivedFrame(detections, now_ns)
        held, ahead_ns = self._held.get(camera, []), self._ahead_ns(detections, now_ns)
        if ahead_ns is None or abs(ahead_ns) <= JUMP_NS:
            self._drop(camera, now_ns)
            return [frame]
        if held and abs(_between_ns(held[-1], frame)) > JUMP_NS:
            self._drop(camera, now_ns)
        held = self._held.get(camera, [])
        # A repeated old message is no sign of a running clock.
        repeated = bool(held) and not _follows(held[-1].detections, detections)
        frame.size_bytes = _bytes(detections)
        full = self._held_bytes() + frame.size_bytes > HELD_MAX_BYTES
        if repeated or full or (not held and len(self._held) >= CAMERAS_MAX):
            self.counters["stray_frames"] += 1
            return []
        held = self._held.setdefault(camera, held)
        held.append(frame)
        if len(held) > HELD_MAX:  # the first frame stays: it marks the beginning of the silence
            self.counters["stray_frames"] += 1
            del held[1]
        return []

    def is_reset(self, detections: Detections) -> bool:
        """Return True if the clock of a camera went back by more than a late frame explains."""
        newest_ns = self.clocks.newest_ns(detections.camera)
        return newest_ns is not None and newest_ns - detections.stamp_ns > JUMP_NS

    def due(self, now_ns: int, flush: bool = False) -> list[ArrivedFrame]:
        """Return held frames of cameras whose previous clock is silent; with `flush` all."""
        due = [
            camera
            for camera, held in self._held.items()
            if flush or now_ns >= self._due_ns(camera, held)
        ]
        return [frame for camera in due for frame in self._held.pop(camera)]

    def wake_ns(self) -> int | None:
        """Return the monotonic time at which held frames are due; None if no frame is held."""
        return min((self._due_ns(*waiting) for waiting in self._held.items()), default=None)

    def reasons(self, now_ns: int) -> list[str]:
        """Return a status message for each camera with recently dropped frames."""
        self._strays = {c: s for c, s in self._strays.items() if now_ns - s[0] < REPORTED_NS}
        return [
            f"frames in the name of camera {camera} with stamps {abs(ahead_s):.1f} s "
            f"{'ahead of' if ahead_s > 0 else 'behind'} its clock are dropped: does another "
            "publisher use its name?"
            for camera, (_, ahead_s) in self._strays.items()
        ]

    def _due_ns(self, camera: str, held: Sequence[ArrivedFrame]) -> int:
        """Return the monotonic time at which the previous clock of a camera counts as silent."""
        rare_ns = min(SILENT_INTERVALS * self.clocks.interval_ns(camera), SILENT_MAX_NS)
        return held[0].arrived_ns + max(SILENT_NS, rare_ns)

    def _drop(self, camera: str, now_ns: int) -> None:
        """Drop the held frames of a camera, since a frame with its own clock arrived."""
        for frame in self._held.pop(camera, ()):
            self.counters["stray_frames"] += 1
            ahead_ns = self._ahead_ns(frame.detections, frame.arrived_ns) or 0
            self._strays[camera] = now_ns, ahead_ns / 1e9

    def _held_bytes(self) -> int:
        return sum(frame.size_bytes for held in self._held.values() for frame in held)

    def _ahead_ns(self, detections: Detections, now_ns: int) -> int | None:
        """Return the offset of a stamp from its camera's clock [ns]; None before the first frame.

        During silence the clock of a live camera runs, the clock of a recording stops.
        """
        newest_ns = self.clocks.newest_ns(detections.camera)
        if newest_ns is None:
            return None
        ahead_ns = detections.stamp_ns - newest_ns
        elapsed_ns = self.clocks.elapsed_ns(detections.camera, now_ns)
        if elapsed_ns is None:  # the downtime of this process is unknown
            return min(ahead_ns, 0)
        return min(ahead_ns, 0) + max(ahead_ns - elapsed_ns, 0)


def _bytes(detections: Detections) -> int:
    masks = (len(person.mask.bits) for person in detections.detections if person.mask)
    return PERSON_BYTES * (1 + len(detections.detections)) + sum(masks)


def _follows(before: Detections, after: Detections) -> bool:
    return after.sequence > before.sequence and after.stamp_ns >= before.stamp_ns


def _between_ns(before: ArrivedFrame, after: ArrivedFrame) -> int:
    return after.detections.stamp_ns - before.detections.stamp_ns
