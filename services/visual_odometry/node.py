"""Node of the visual odometry: frames in, odometry out."""

from collections import Counter, deque
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from common.geometry.frame_graph import FrameGraph
from common.runtime.node import Node, Status
from common.transport.trace import span
from people4d.messages import (
    F64,
    CameraInfo,
    Detections,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
)
from services.visual_odometry.config import MAP, VisualOdometryConfig
from services.visual_odometry.corners import OdometryFrame, PeopleRegions, ReducedCamera
from services.visual_odometry.keyframe import PoseEstimate
from services.visual_odometry.odometer import COUNTERS, START, Odometer
from services.visual_odometry.reprojection import BaseMount

OWN_COUNTERS = (
    *("no_camera_info", "no_transform", "wrong_size", "stale", "clock_resets", "other_cameras"),
    *("calibration_changes", "other_odometry", "unanswered"),
)
OWN_MAX = 256  # maximum number of remembered own messages
SILENT_FRAMES = 5  # minimum number of frames without odometry before the reason is reported
PEOPLE_AGE_S = 0.4  # maximum age of detections used as regions of people [s]
CLOCK_JUMP_S = 1.0  # minimum backward step of the stamps in a clock reset [s]
CAUSES = {
    "no_texture": "the image has no texture",
    "no_depth": "the texture in the image has no depth",
    "not_followed": "no point of the last images could be tracked",
    "too_few_agree": "too few points agree on one motion",
    "uncertain": "the image does not determine the motion well enough",
    "implausible": "the motion is faster than the base can move",
}


class VisualOdometryNode(Node):
    """Estimates the motion of the base that one camera is mounted on.

    Each frame gives one Odometry with its stamp (a MovingTransform if the base moves freely). A
    frame without odometry is counted as `unanswered`, and by its cause. If another process
    publishes odometry of the base, this node is silent: two origins would make tracks jump.
    """

    inputs: tuple[type[Message], ...] = (
        *(RgbdFrame, Detections, CameraInfo),
        *(StaticTransform, Odometry),
    )
    required_inputs: ClassVar[tuple[type[Message], ...]] = (RgbdFrame,)

    def __init__(self, config: VisualOdometryConfig) -> None:
        self._config = config
        self._camera = config.camera
        self._info: CameraInfo | None = None
        self._infos: dict[str, CameraInfo] = {}
        self._frames = FrameGraph()
        self._odometer: Odometer | None = None
        self._mount: F64 | None = None  # base_from_optical of the odometer
        self._pose: PoseEstimate = START
        self._found: tuple[int, PeopleRegions] | None = None  # newest detections and their stamp
        self._last_ns: int | None = None
        self._sequence = 0
        self._silent = 0  # number of consecutive frames without odometry
        self._sent: deque[tuple[int, float, float]] = deque(maxlen=OWN_MAX)
        self._others = False  # other processes publish odometry
        self._counters = Counter(dict.fromkeys((*OWN_COUNTERS, *COUNTERS), 0))
        self._cause = ""

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Process one message; return the odometry of a frame."""
        if isinstance(message, RgbdFrame):
            return self._estimate(message)
        if isinstance(message, Detections):
            self._mark_people(message)
        elif isinstance(message, CameraInfo):
            if message.camera in self._infos or len(self._infos) < 64:  # bounds the memory
                self._infos[message.camera] = message
        elif isinstance(message, StaticTransform):
            self._frames.add_transform(message)
        elif isinstance(message, Odometry):
            self._check_origin(message)
        return ()

    def status(self) -> Status:
        """Return the counters, and the cause of missing odometry as the reason."""
        reason = self._reason()
        return Status(
            state="degraded" if reason else "ready", reason=reason, counters=dict(self._counters)
        )

    def _estimate(self, frame: RgbdFrame) -> list[Message]:
        if not self._is_next(frame):
            return []
        odometer = self._ready(frame)
        pose = None
        if odometer:
            before = dict(self._counters)
            with span("motion"):
                pose = odometer.add_frame(self._with_people(frame))
            self._pose = odometer.pose
            self._cause = next((c for c in CAUSES if self._counters[c] > before[c]), self._cause)
        if pose is None or self._others:
            self._silent += 1
            self._counters["unanswered"] += 1
            return []
        self._silent = 0
        return [self._odometry(frame, pose)]

    def _is_next(self, frame: RgbdFrame) -> bool:
        """Check that a frame is from this camera and newer; restart after a clock reset."""
        self._camera = self._camera or frame.camera
        if frame.camera != self._camera:
            self._counters["other_cameras"] += 1
            return False
        last_ns, jump_ns = self._last_ns, CLOCK_JUMP_S * 1e9
        if last_ns is not None and last_ns - frame.stamp_ns > jump_ns:
            self._counters["clock_resets"] += 1
            self._odometer, self._pose, self._found = None, START, None
        elif last_ns is not None and frame.stamp_ns <= last_ns:
            self._counters["stale"] += 1
            return False
        self._last_ns = frame.stamp_ns
        return True

    def _ready(self, frame: RgbdFrame) -> Odometer | None:
        """Return the odometer, restarted if calibration or mounting changed."""
        info = self._infos.get(frame.camera)
        mount = self._frames.lookup(self._config.child_frame_id, info.frame_id) if info else None
        if info is None or mount is None or frame.rgb.shape[:2] != (info.height, info.width):
            sized = info is not None and frame.rgb.shape[:2] == (info.height, info.width)
            self._cause = "no_transform" if sized else "wrong_size" if info else "no_camera_info"
            self._counters[self._cause] += 1
            return None
        changed = self._mount is not None and not (
            np.array_equal(mount, self._mount) and _calibration(info) == _calibration(self._info)
        )
        self._counters["calibration_changes"] += changed
        if self._odometer is None or changed:
            self._info, self._mount = info, mount
            config = self._config
            camera = ReducedCamera(info, config.width_px)
            camera_mount = BaseMount(mount, config.planar)
            self._odometer = Odometer(config, camera, camera_mount, self._counters, self._pose)
        return self._odometer

    def _with_people(self, frame: RgbdFrame) -> OdometryFrame:
        people = PeopleRegions()
        if self._found:
            found_ns, found = self._found
            age_s = (frame.stamp_ns - found_ns) / 1e9
            people = found if 0 <= age_s <= PEOPLE_AGE_S else people
        return OdometryFrame(frame.stamp_ns, frame.rgb, frame.depth_mm, people)

    def _mark_people(self, detections: Detections) -> None:
        if detections.camera != self._camera:
            return
        found = people_of(detections)
        if self._found is None or detections.stamp_ns > self._found[0] or self._odometer is None:
            self._found = detections.stamp_ns, found
        if self._odometer:
            self._odometer.mark_people(detections.stamp_ns, found)

    def _check_origin(self, odometry: Odometry) -> None:
        if odometry.child_frame_id != self._config.child_frame_id:
            return
        if (odometry.stamp_ns, odometry.x_m, odometry.theta_rad) not in self._sent:
            self._counters["other_odometry"] += 1
            self._others = True

    def _odometry(self, frame: RgbdFrame, pose: PoseEstimate) -> Message:
        config, sequence = self._config, self._sequence
        self._sequence += 1
        known = self._frames.path(MAP, config.frame_id) is not None
        parent = config.frame_id if known else MAP
        if not config.planar:
            return MovingTransform(
                stamp_ns=frame.stamp_ns,
                sequence=sequence,
                trace=frame.trace,
                parent=parent,
                child=config.child_frame_id,
                matrix=pose.matrix,
            )
        theta_rad = float(np.arctan2(pose.matrix[1, 0], pose.matrix[0, 0]))
        odometry = Odometry(
            stamp_ns=frame.stamp_ns,
            sequence=sequence,
            trace=frame.trace,
            frame_id=parent,
            child_frame_id=config.child_frame_id,
            x_m=float(pose.matrix[0, 3]),
            y_m=float(pose.matrix[1, 3]),
            theta_rad=theta_rad,
            covariance=pose.covariance,
        )
        self._sent.append((odometry.stamp_ns, odometry.x_m, odometry.theta_rad))
        return odometry

    def _reason(self) -> str:
        config = self._config
        if self._others:
            base = config.child_frame_id
            return f"another process publishes odometry of {base}, so this one is silent"
        if self._silent < SILENT_FRAMES:
            return ""
        size = f"{self._infos[self._camera].width} px wide" if self._camera in self._infos else ""
        inputs = {
            "no_camera_info": f"no calibration of camera {self._camera} was received",
            "wrong_size": f"images of {self._camera} differ in size from its calibration ({size})",
            "no_transform": f"no transform {config.child_frame_id} <- {self._camera} "
            f"(set camera.mount_parent={config.child_frame_id})",
        }
        return f"no odometry: {(inputs | CAUSES).get(self._cause, 'the motion is unknown')}"


def people_of(detections: Detections) -> PeopleRegions:
    """Return the regions of detected people."""
    found = detections.detections
    boxes = np.array([one.box_xyxy_px for one in found], np.float64).reshape(-1, 4)
    depths = [np.nan if one.position_m is None else float(one.position_m[2]) for one in found]
    return PeopleRegions(boxes, np.array(depths, np.float64))


def _calibration(info: CameraInfo | None) -> tuple[object, ...]:
    """Return the relevant numbers of a calibration."""
    if info is None:
        return ()
    numbers = (info.width, info.height, info.fx, info.fy, info.cx, info.cy)
    return (*numbers, info.distortion_model, tuple(info.distortion))
