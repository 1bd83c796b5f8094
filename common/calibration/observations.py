"""Detections of several cameras, collected for their calibration."""

from collections import defaultdict, deque
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from common.calibration.floor import thinned
from common.geometry.transforms import deproject
from people4d.messages import F64, U16, CameraInfo, Detection, Detections
from people4d.messages.base import MAX_CAMERAS

FRAMES_MAX = 60_000  # maximum number of frames of a camera: 33 minutes at 30 Hz
SHOULDERS, HIPS, ANKLES = [5, 6], [11, 12], [15, 16]  # COCO
# Maximum number of contradictions after a restart of a camera or its detector
CONTRADICTIONS_MAX = 10
LIMBS = [5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16]  # shoulders to ankles
# Maximum number of depth images of a camera, and their interval [ns]
DEPTHS_MAX, DEPTH_EVERY_NS = 60, 1_000_000_000
CONFIDENCE_MIN = 0.3  # minimum confidence of shoulders, hips and ankles
LIMB_CONFIDENCE_MIN = 0.6  # minimum confidence of limbs, above guesses of hidden ones


@dataclass(frozen=True, slots=True)
class ObservedPerson:
    """One person in one image, in the optical frame of the camera."""

    position_m: F64  # 3, torso
    low_ray: F64 | None  # 3, towards the middle of the ankles, or of the hips; None: not found
    is_low_ankle: bool  # True if low_ray points to the ankles
    high_ray: F64 | None  # 3, towards the middle of the shoulders
    limbs: F64 | None = None  # 12x2, rays to shoulders ... ankles at z = 1, NaN: not found


@dataclass(slots=True)
class ObservedFrame:
    """The people in one frame."""

    stamp_ns: int  # stamp on the camera's clock
    people: tuple[ObservedPerson, ...]


@dataclass(slots=True)
class CameraObservations:
    """All frames of one camera."""

    camera: str
    frame_id: str = ""  # optical frame
    info: CameraInfo | None = None
    frames: list[ObservedFrame] = field(default_factory=list)
    delay_ns: int | None = None  # [ns] minimum time from stamp to arrival, on two clocks
    unlocated: int = 0  # number of people without a position
    sequence: int = -1  # sequence number of the last frame
    # Thinned depth images
    depths_mm: deque[U16] = field(default_factory=lambda: deque(maxlen=DEPTHS_MAX))
    depth_ns: int | None = None  # stamp of the last depth image
    contradictions: int = 0  # number of frames whose stamp rises while their sequence does not

    @property
    def people(self) -> int:
        """Number of people with a position, over all frames."""
        return sum(len(frame.people) for frame in self.frames)

    def coverage(self) -> npt.NDArray[np.bool_]:
        """Return the covered parts of the view (3x3): far, middle, near; left, middle, right."""
        cells = np.zeros((3, 3), np.bool_)
        at = [p.position_m for frame in self.frames for p in frame.people]
        if self.info is None or not at:
            return cells
        x, _, z = np.array(at).T
        column = (x / z * self.info.fx + self.info.cx) / self.info.width * 3
        row = 3 - z / self.info.max_depth_m * 3
        cells[row.astype(int).clip(0, 2), column.astype(int).clip(0, 2)] = True
        return cells

    @property
    def is_of_several(self) -> bool:
        """True if two cameras or more have this name."""
        return self.contradictions > max(CONTRADICTIONS_MAX, len(self.frames) // 10)


class ObservationCollector:
    """Collects the observations of a calibration from messages."""

    def __init__(self) -> None:
        self._cameras: dict[str, CameraObservations] = {}
        self.dropped: dict[str, int] = defaultdict(int)  # number of dropped frames by reason

    @property
    def cameras(self) -> list[CameraObservations]:
        """The cameras that sent detections, by name."""
        return sorted((c for c in self._cameras.values() if c.frames), key=lambda c: c.camera)

    def copy(self) -> "ObservationCollector":
        """Return a copy, unaffected by later messages."""
        other = ObservationCollector()
        other._cameras = {
            name: replace(camera, frames=list(camera.frames), depths_mm=camera.depths_mm.copy())
            for name, camera in self._cameras.items()
        }
        return other

    def wants_depth(self, camera: str, stamp_ns: int) -> bool:
        """Check that another depth image of a camera with detections is due."""
        known = self._cameras.get(camera)
        if known is None:
            return False
        return known.depth_ns is None or not 0 <= stamp_ns - known.depth_ns < DEPTH_EVERY_NS

    def add_depth(self, camera: str, stamp_ns: int, depth_mm: U16) -> None:
        """Store a depth image (HxW) of a camera, for the floor."""
        known = self._cameras[camera]
        known.depth_ns = stamp_ns
        known.depths_mm.append(thinned(depth_mm))

    def add_message(self, message: CameraInfo | Detections, arrived_ns: int) -> None:
        """Store a message; late frames, and frames beyond a limit, are counted and dropped.

        Args:
            message: Calibration or detections of any camera.
            arrived_ns: Time of arrival or of recording, on one clock for all cameras [ns].
        """
        known = self._cameras.get(message.camera)
        if known is None:
            if len(self._cameras) >= MAX_CAMERAS:
                self.dropped["cameras"] += 1
                return
            known = self._cameras[message.camera] = CameraObservations(message.camera)
        if isinstance(message, CameraInfo):
            known.info = message
            return
        if known.frames:
            is_later = message.stamp_ns > known.frames[-1].stamp_ns
            known.contradictions += is_later != (message.sequence > known.sequence)
            if not is_later:
                self.dropped["disorder"] += 1
                return
        if len(known.frames) >= FRAMES_MAX:
            self.dropped["too_many"] += 1
            return
        known.frame_id, known.sequence = message.frame_id, message.sequence
        people = tuple(_person(d, known.info) for d in message.detections if _is_located(d))
        known.unlocated += len(message.detections) - len(people)
        known.frames.append(ObservedFrame(message.stamp_ns, people))
        delay_ns = arrived_ns - message.stamp_ns
        known.delay_ns = delay_ns if known.delay_ns is None else min(known.delay_ns, delay_ns)


def _is_located(detection: Detection) -> bool:
    return detection.position_m is not None and float(detection.position_m[2]) > 0.1


def _person(detection: Detection, info: CameraInfo | None) -> ObservedPerson:
    assert detection.position_m is not None
    ankles = _ray(detection, ANKLES, info)
    low = _ray(detection, HIPS, info) if ankles is None else ankles
    high = _ray(detection, SHOULDERS, info)
    limbs = _limbs(detection, info)
    return ObservedPerson(detection.position_m, low, ankles is not None, high, limbs)


def _limbs(detection: Detection, info: CameraInfo | None) -> F64 | None:
    if info is None or detection.keypoints is None:
        return None
    points = detection.keypoints[LIMBS].astype(np.float64)
    rays = deproject(points[:, :2], np.ones(len(points)), info)[:, :2]
    rays[points[:, 2] < LIMB_CONFIDENCE_MIN] = np.nan
    return np.asarray(rays)


def _ray(detection: Detection, joints: list[int], info: CameraInfo | None) -> F64 | None:
    """Return the direction (3, z = 1) of the middle of two joints; None if one is not found."""
    if info is None or detection.keypoints is None:
        return None
    points = detection.keypoints[joints]
    if float(points[:, 2].min()) < CONFIDENCE_MIN:
        return None
    middle = points[:, :2].mean(axis=0).astype(np.float64)
    if not (0 < middle[1] < info.height - 1):
        return None
    return np.asarray(deproject(middle[None], 1.0, info)[0])
