"""People of one frame, joined from detections and tracks for the viewers."""

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from common.drawing.people import CONFIDENCE_MIN, LIMBS
from common.geometry.keypoints import lift
from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import apply
from people4d.messages import (
    F32,
    F64,
    JOINTS,
    CameraInfo,
    Detection,
    Detections,
    Message,
    MovingTransform,
    Odometry,
    Skeletons,
    StaticTransform,
    Track,
    Tracks,
)
from people4d.messages.base import MAX_CAMERAS
from people4d.messages.prediction import PersonPrediction

WAITING_MAX = 32  # maximum number of detections without their tracks
TRAJECTORY_S = 10.0  # length of a trajectory [s]
TRAJECTORIES_MAX = 256  # maximum number of trajectories


@dataclass(frozen=True, slots=True)
class ScenePerson:
    """Person in a frame: a detection, a track, or a detection with its track."""

    track: Track | None = None
    detection: Detection | None = None

    @property
    def id(self) -> int | None:
        """Identity; None for a detection without a track."""
        return self.track.id if self.track else None

    @property
    def label(self) -> str:
        """Identity and speed, or the score of a detection without a track."""
        if self.track is not None:
            return f"#{self.track.id}  {np.linalg.norm(self.track.velocity_mps):.1f} m/s"
        return f"{self.detection.score:.2f}" if self.detection else ""

    def limbs_px(self) -> Iterator[F32]:
        """Yield the ends (2x2) of each visible limb in the image."""
        keypoints = self.detection.keypoints if self.detection else None
        if keypoints is None:
            return
        for limb in LIMBS:
            ends = keypoints[list(limb)]
            if (ends[:, 2] >= CONFIDENCE_MIN).all():
                yield ends[:, :2]


@dataclass(frozen=True, slots=True)
class SceneSkeleton:
    """Joints of a person in 3D."""

    id: int | None  # identity; None for a detection without a track
    joints_m: F64  # 17x3; NaN for unknown joints
    measured: tuple[bool, ...] = (True,) * len(JOINTS)  # measured (else predicted), by joint

    def limbs(self) -> Iterator[tuple[F64, bool]]:
        """Yield the ends (2x3) of each known limb, and whether both are measured."""
        for a, b in LIMBS:
            ends_m = self.joints_m[[a, b]]
            if np.isfinite(ends_m).all():
                yield ends_m, self.measured[a] and self.measured[b]


@dataclass(frozen=True, slots=True)
class SkeletonFrame:
    """Skeletons of one frame."""

    stamp_ns: int
    frame_id: str  # frame of the joints and tracks
    skeletons: tuple[SceneSkeleton, ...]


@dataclass(frozen=True, slots=True)
class PeopleFrame:
    """People of one frame."""

    tracks: Tracks
    info: CameraInfo | None  # calibration of the camera
    frame_from_optical: F64 | None  # pose of the camera in the frame of the tracks, 4x4
    people: tuple[ScenePerson, ...] = ()
    # keypoints lifted by depth; None if the pose is unknown, or the topic skeletons exists
    skeletons: SkeletonFrame | None = None
    trajectories: Mapping[int, F64] = field(default_factory=dict)  # recent positions Nx3 [m], by id


class PeopleScene:
    """Joins detections with their tracks, and collects trajectories in bounded memory."""

    inputs: tuple[type[Message], ...] = (
        CameraInfo,
        StaticTransform,
        MovingTransform,
        Odometry,
        Detections,
        Tracks,
        Skeletons,
    )

    def __init__(self) -> None:
        self.transforms = TransformBuffer()
        self.infos: dict[str, CameraInfo] = {}
        self._waiting: dict[tuple[str, int], Detections] = {}
        self._trajectories: dict[int, deque[tuple[int, F64]]] = {}
        self._newest_ns = 0
        self._skeleton_cameras: set[str] = set()  # cameras with a topic of skeletons

    def add_message(self, message: Message) -> PeopleFrame | None:
        """Add a message; return the people of a frame when its tracks arrive."""
        if isinstance(message, CameraInfo):
            if message.camera in self.infos or len(self.infos) < MAX_CAMERAS:
                self.infos[message.camera] = message
        elif isinstance(message, StaticTransform | MovingTransform | Odometry):
            self.transforms.add_transform(message)
        elif isinstance(message, Detections):
            self._waiting[message.camera, message.stamp_ns] = message
            if len(self._waiting) > WAITING_MAX:
                del self._waiting[next(iter(self._waiting))]
        elif isinstance(message, Tracks):
            return self._people(message)
        return None

    def skeletons(self, message: Skeletons) -> SkeletonFrame:
        """Return the skeletons of a message, which replace lifted keypoints of its camera."""
        if len(self._skeleton_cameras) < MAX_CAMERAS:
            self._skeleton_cameras.add(message.camera)
        people = (
            SceneSkeleton(one.id, one.positions_m.astype(float), one.measured)
            for one in message.people
        )
        return SkeletonFrame(message.stamp_ns, message.frame_id, tuple(people))

    def _people(self, tracks: Tracks) -> PeopleFrame:
        detections = self._waiting.pop((tracks.camera, tracks.stamp_ns), None)
        info = self.infos.get(tracks.camera)
        pose = None
        if info:
            pose = self.transforms.camera_pose(tracks.frame_id, info.frame_id, tracks.stamp_ns)
        if not tracks.predicted:  # stamps of predictions may be ahead of later frames
            self._extend(tracks)
        people, skeletons = tuple(_views(tracks, detections)), None
        if info and pose is not None and tracks.camera not in self._skeleton_cameras:
            found = tuple(_lifted(people, info, pose))
            skeletons = SkeletonFrame(tracks.stamp_ns, tracks.frame_id, found)
        return PeopleFrame(
            tracks=tracks,
            info=info,
            frame_from_optical=pose,
            people=people,
            skeletons=skeletons,
            trajectories=self._recent(tracks),
        )

    def _extend(self, tracks: Tracks) -> None:
        if tracks.stamp_ns < self._newest_ns:  # the source restarted
            self._trajectories.clear()
        self._newest_ns = tracks.stamp_ns
        for track in tracks.tracks:
            if track.state != "tentative":
                points = self._trajectories.setdefault(track.id, deque(maxlen=1000))
                points.append((tracks.stamp_ns, track.position_m))
        oldest_ns = self._newest_ns - round(TRAJECTORY_S * 1e9)
        for track_id, points in list(self._trajectories.items()):
            while points and points[0][0] < oldest_ns:
                points.popleft()
            if not points or len(self._trajectories) > TRAJECTORIES_MAX:
                del self._trajectories[track_id]

    def _recent(self, tracks: Tracks) -> dict[int, F64]:
        present = {track.id for track in tracks.tracks}
        return {
            track_id: np.array([position_m for _, position_m in points])
            for track_id, points in self._trajectories.items()
            if track_id in present
        }


def predicted_path(person: PersonPrediction) -> F64:
    """Return the predicted positions (Nx3) at the current height [m]."""
    height = np.full(len(person.means_m), person.position_m[2])
    return np.column_stack([person.means_m, height])


def _views(tracks: Tracks, detected: Detections | None) -> list[ScenePerson]:
    owners = {t.detection: t for t in tracks.tracks if t.detection is not None}
    found = [
        ScenePerson(owners.get(k), detection)
        for k, detection in enumerate(detected.detections if detected else ())
    ]
    matched = {view.track.id for view in found if view.track}
    return found + [ScenePerson(track=t) for t in tracks.tracks if t.id not in matched]


def _lifted(
    people: tuple[ScenePerson, ...], info: CameraInfo, frame_from_optical: F64
) -> Iterator[SceneSkeleton]:
    for view in people:
        joints_m = lift(view.detection, info) if view.detection else None
        if joints_m is not None:
            yield SceneSkeleton(view.id, apply(frame_from_optical, joints_m))
