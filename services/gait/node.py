"""Frames with their people in, how these walk out."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np

from common.geometry.transforms import apply, invert
from common.runtime.node import Node, Status
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
from services.gait.cascade import Seen
from services.gait.config import GaitConfig
from services.gait.join import Join, Moment
from services.gait.people import COUNTERS, Found, People, Scene
from services.gait.places import Places

OWN_COUNTERS = ("passed_over", "no_camera_info", "no_transform")
PATIENCE = 10  # times settle_s, after which a frame is done in any case
CAMERAS_MAX = 64  # with people; whoever sends more names is no camera

Watch = Callable[[CameraInfo, Scene, Sequence[Found]], None]


class GaitNode(Node):
    """Follows points on the bodies of tracked people, at its own rate.

    Live, the newest complete frame of a camera wins and older ones are counted `passed_over`: what
    takes long delays nobody. Frames that come meanwhile wait for their tracks, since whoever took
    only the newest would have none for as long as the pipeline takes. In lock-step playback frames
    are done in turn, as far as they are kept; nobody waits for the answer.

    Args:
        config: The configuration.
        watch: Told of every frame that was done, to draw it.
    """

    inputs: ClassVar[tuple[type[Message], ...]] = (
        *(RgbdFrame, Detections, Tracks, CameraInfo),
        *(StaticTransform, MovingTransform, Odometry),
    )
    required_inputs: ClassVar[tuple[type[Message], ...]] = (RgbdFrame, Tracks)

    def __init__(self, config: GaitConfig, watch: Watch | None = None) -> None:
        self._config, self._watch = config, watch
        self.frames_waiting = config.frames
        self._join = Join(config.frames)
        self._places = Places(config.base)
        self._infos: dict[str, CameraInfo] = {}
        self._people: dict[str, People] = {}
        self._ready: dict[str, Moment] = {}
        self._due_ns, self._first_ns = 0, 0
        self._counters = Counter(dict.fromkeys((*OWN_COUNTERS, *COUNTERS), 0))

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Take one message; in lock-step return the gait that follows from it."""
        if isinstance(message, CameraInfo):
            self._calibrate(message)
        elif isinstance(message, StaticTransform | MovingTransform | Odometry):
            self._places.add(message)
        elif isinstance(message, RgbdFrame | Detections | Tracks):
            moment = self._join.add(message)
            if moment and moment.frame.lockstep:
                return self._follow(moment)
            if moment:
                self._wait(moment, now_ns)
        return ()

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return the gait in the newest frame of the camera that waits longest."""
        if not self._ready or now_ns < self._due_ns:
            return ()
        return self._follow(self._ready.pop(next(iter(self._ready))))

    def wake_ns(self) -> int | None:
        """Return when a frame has waited long enough for a newer one."""
        return self._due_ns if self._ready else None

    def status(self) -> Status:
        """Tell what is missing and what was counted."""
        return Status(counters={**self._counters, **self._join.counters, **self._places.counters})

    def _wait(self, moment: Moment, now_ns: int) -> None:
        """Let a frame wait until no newer one comes at once, but not for ever."""
        settle_ns = int(self._config.settle_s * 1e9)
        self._first_ns = self._first_ns if self._ready else now_ns
        self._counters["passed_over"] += moment.frame.camera in self._ready
        self._ready[moment.frame.camera] = moment
        self._due_ns = min(now_ns + settle_ns, self._first_ns + PATIENCE * settle_ns)

    def _calibrate(self, info: CameraInfo) -> None:
        before = self._infos.get(info.camera)
        if before is None and len(self._infos) >= CAMERAS_MAX:
            return
        self._infos[info.camera] = info
        if before is None or _lens(before) != _lens(info):
            self._people.pop(info.camera, None)

    def _follow(self, moment: Moment) -> list[Message]:
        camera, tracks = moment.frame.camera, moment.tracks
        info = self._infos.get(camera)
        if info is None:
            self._counters["no_camera_info"] += 1
            return []
        pose = self._places.find(tracks.frame_id, moment.detections.frame_id, tracks.stamp_ns)
        if pose is None:
            self._counters["no_transform"] += 1
            return []
        people = self._people.setdefault(camera, People(self._config, info, self._counters))
        scene = Scene(
            stamp_ns=tracks.stamp_ns,
            rgb=moment.frame.rgb,
            depth_mm=moment.frame.depth_mm,
            seen=_seen(moment, pose),
            fixed_from_optical=pose,
        )
        with span("points"):
            found = people.update(scene)
        if found is None:
            return []
        if self._watch:
            self._watch(info, scene, found)
        told = Gait(
            stamp_ns=tracks.stamp_ns,
            sequence=tracks.sequence,
            trace=tracks.trace,
            frame_id=tracks.frame_id,
            camera=camera,
            people=tuple(one.person for one in found),
        )
        return [told]


def _lens(info: CameraInfo) -> tuple[object, ...]:
    """Return what of a calibration counts here."""
    numbers = (info.width, info.height, info.fx, info.fy, info.cx, info.cy)
    return (*numbers, info.distortion_model, tuple(info.distortion))


def _seen(moment: Moment, pose: F64) -> list[Seen]:
    """Return what is known of each person, by what was found and tracked."""
    optical_from_fixed = invert(pose)
    people = {t.id: t for t in moment.tracks.tracks if t.state != "tentative"}
    return [_one(track, moment.detections, optical_from_fixed) for track in people.values()]


def _one(track: Track, detections: Detections, optical_from_fixed: F64) -> Seen:
    depth_m = float(apply(optical_from_fixed, track.position_m[None])[0, 2])
    box, keypoints = None, None
    if track.detection is not None and track.detection < len(detections.detections):
        detection = detections.detections[track.detection]
        box, keypoints = detection.box_xyxy_px.astype(np.float64), detection.keypoints
        if detection.position_m is not None:
            depth_m = float(detection.position_m[2])
    known = np.isfinite(depth_m) and depth_m > 0
    return Seen(
        id=track.id, box_xyxy_px=box, keypoints=keypoints, depth_m=depth_m if known else None
    )
