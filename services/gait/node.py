"""Node of the gait service: frames with tracked people in, their gait out."""

from collections import Counter
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import apply, invert
from common.runtime.node import Node, Status
from common.runtime.synchroniser import FrameParts, Synchroniser
from common.transport.trace import span
from people4d.messages import (
    F64,
    CameraInfo,
    Detections,
    Gait,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
    Track,
    Tracks,
)
from people4d.messages.base import MAX_CAMERAS
from services.gait.cascade import PersonObservation
from services.gait.config import GaitConfig
from services.gait.estimator import ESTIMATOR_COUNTERS, GaitEstimator, GaitFrame, OnFrame

PENDING_MAX = 256  # Maximum number of pending frames of all cameras
NODE_COUNTERS = (
    *("passed_over", "no_camera_info", "no_transform"),
    "without_frame",  # tracks whose frame was dropped
    "frames_unused",  # frames without tracks: skipped by the detector, or tracks were late
)
SETTLE_S = 0.003  # Waiting time of a frame for a newer one of its camera [s]
SETTLE_MAX = 10  # Maximum wait of a frame [SETTLE_S]


class GaitNode(Node):
    """Tracks points on the bodies of tracked people, at its own rate.

    Live, the newest complete frame of a camera is processed and older ones are counted as
    `passed_over`, so the delay of a slow node does not grow. Frames wait for their tracks, which
    arrive later by the latency of the pipeline. In lock-step playback all frames are processed in
    turn if the buffer holds them; playback does not wait. `on_frame` is called with every processed
    frame.
    """

    inputs: tuple[type[Message], ...] = (
        *(RgbdFrame, Detections, Tracks, CameraInfo),
        *(StaticTransform, MovingTransform, Odometry),
    )
    required_inputs: ClassVar[tuple[type[Message], ...]] = (RgbdFrame, Tracks)

    def __init__(self, config: GaitConfig, on_frame: OnFrame | None = None) -> None:
        self._config, self._on_frame = config, on_frame
        self.frames_waiting = config.frames
        self._synchroniser = Synchroniser(PENDING_MAX, config.frames)
        self._transforms = TransformBuffer()
        self._infos: dict[str, CameraInfo] = {}
        self._estimators: dict[str, GaitEstimator] = {}
        self._ready: dict[str, FrameParts] = {}
        self._due_ns, self._first_ns = 0, 0
        self._counters = Counter(dict.fromkeys((*NODE_COUNTERS, *ESTIMATOR_COUNTERS), 0))

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Handle a message; in lock-step return the gait of its frame."""
        if isinstance(message, CameraInfo):
            self._calibrate(message)
        elif isinstance(message, StaticTransform | MovingTransform | Odometry):
            self._transforms.add_transform(message)
        elif isinstance(message, RgbdFrame | Detections | Tracks):
            for joined in self._synchroniser.add_message(message):
                parts = joined.parts()
                if parts is None:
                    self._counters["frames_unused"] += joined.image is not None
                    lost = not joined.image and joined.detections and joined.tracks
                    self._counters["without_frame"] += bool(lost)
                elif parts[0].lockstep:
                    return self._process(*parts)
                else:
                    self._wait(parts, now_ns)
        return ()

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return the gait in the newest frame of the longest waiting camera."""
        if not self._ready or now_ns < self._due_ns:
            return ()
        return self._process(*self._ready.pop(next(iter(self._ready))))

    def wake_ns(self) -> int | None:
        """Return the time at which a frame has waited long enough for a newer one."""
        return self._due_ns if self._ready else None

    def status(self) -> Status:
        """Return the counters."""
        return Status(counters={**self._counters, **self._transforms.counters})

    def _wait(self, parts: FrameParts, now_ns: int) -> None:
        settle_ns = int(SETTLE_S * 1e9)
        self._first_ns = self._first_ns if self._ready else now_ns
        self._counters["passed_over"] += parts[0].camera in self._ready
        self._ready[parts[0].camera] = parts
        self._due_ns = min(now_ns + settle_ns, self._first_ns + SETTLE_MAX * settle_ns)

    def _calibrate(self, info: CameraInfo) -> None:
        before = self._infos.get(info.camera)
        if before is None and len(self._infos) >= MAX_CAMERAS:
            return
        self._infos[info.camera] = info
        if before is None or _intrinsics(before) != _intrinsics(info):
            self._estimators.pop(info.camera, None)

    def _process(self, image: RgbdFrame, detections: Detections, tracks: Tracks) -> list[Message]:
        camera = image.camera
        info = self._infos.get(camera)
        if info is None:
            self._counters["no_camera_info"] += 1
            return []
        optical = detections.frame_id
        pose = self._transforms.camera_pose(tracks.frame_id, optical, tracks.stamp_ns)
        if pose is None:
            self._counters["no_transform"] += 1
            return []
        if camera not in self._estimators:
            self._estimators[camera] = GaitEstimator(self._config, info, self._counters)
        frame = GaitFrame(
            stamp_ns=tracks.stamp_ns,
            rgb=image.rgb,
            depth_mm=image.depth_mm,
            observations=_observations(detections, tracks, pose),
            fixed_from_optical=pose,
        )
        with span("points"):
            results = self._estimators[camera].update_people(frame)
        if results is None:
            return []
        if self._on_frame:
            self._on_frame(info, frame, results)
        gait = Gait(
            stamp_ns=tracks.stamp_ns,
            sequence=tracks.sequence,
            trace=tracks.trace,
            frame_id=tracks.frame_id,
            camera=camera,
            people=tuple(one.person for one in results),
        )
        return [gait]


def _intrinsics(info: CameraInfo) -> tuple[object, ...]:
    numbers = (info.width, info.height, info.fx, info.fy, info.cx, info.cy)
    return (*numbers, info.distortion_model, tuple(info.distortion))


def _observations(detections: Detections, tracks: Tracks, pose: F64) -> list[PersonObservation]:
    """Return the observations of all confirmed or lost tracks."""
    optical_from_fixed = invert(pose)
    people = {t.id: t for t in tracks.tracks if t.state != "tentative"}
    return [_observation(track, detections, optical_from_fixed) for track in people.values()]


def _observation(
    track: Track, detections: Detections, optical_from_fixed: F64
) -> PersonObservation:
    depth_m = float(apply(optical_from_fixed, track.position_m[None])[0, 2])
    box, keypoints = None, None
    detection = detections.at(track.detection)
    if detection is not None:
        box, keypoints = detection.box_xyxy_px.astype(np.float64), detection.keypoints
        if detection.position_m is not None:
            depth_m = float(detection.position_m[2])
    known = np.isfinite(depth_m) and depth_m > 0
    return PersonObservation(track.id, box, keypoints, depth_m if known else None, track.yaw_rad)
