"""Node of skeletons: detections and tracks in, skeletons out."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.runtime.node import Node, Status
from common.transport.trace import span
from people4d.messages import (
    F64,
    CameraInfo,
    Detections,
    Message,
    MovingTransform,
    Odometry,
    PersonSkeleton,
    Skeletons,
    StaticTransform,
    Track,
    Tracks,
)
from people4d.messages.base import MAX_CAMERAS
from people4d.messages.skeleton import Posture
from services.skeleton.config import SkeletonConfig
from services.skeleton.joint_filter import JointStates
from services.skeleton.objects import ObjectFilter
from services.skeleton.observation import observe_joints
from services.skeleton.posture import PostureFilter
from services.skeleton.skeletons import Flags, People, SkeletonTracker

NODE_COUNTERS = (
    "no_camera_info",
    "no_transform",
    "no_detections",  # tracks without the detections of their frame
    "stale",  # tracks older than the last
    "clock_resets",
    "too_many",  # people beyond people_max
    "repeated",  # tracks with a duplicate id
)
FRAMES_MAX = 64  # maximum number of detections waiting for their tracks
CHILD_M = 1.45  # stature that few adults do not reach [m]
CLOCK_JUMP_NS = 1_000_000_000  # minimum backward step of the stamps in a clock reset [ns]
GAP_MAX_S = 1.0  # maximum interval between two frames of a continued skeleton [s]


class SkeletonNode(Node):
    """Estimates the joints of every tracked person from the keypoints of detections.

    Tracks without the detections of their frame are counted and give no skeletons. A person has one
    skeleton for all cameras.
    """

    inputs: tuple[type[Message], ...] = (
        *(Detections, Tracks, CameraInfo),
        *(StaticTransform, MovingTransform, Odometry),
    )
    required_inputs: ClassVar[tuple[type[Message], ...]] = (Detections, Tracks)

    def __init__(self, config: SkeletonConfig) -> None:
        self._config = config
        self._transforms = TransformBuffer()
        self._infos: dict[str, CameraInfo] = {}
        self._detections: dict[tuple[str, int], Detections] = {}
        self._skeletons = SkeletonTracker()
        self._postures = PostureFilter()
        self._objects = ObjectFilter()
        self._newest_ns: int | None = None
        self._frame_id = ""
        self._counters = Counter(dict.fromkeys(NODE_COUNTERS, 0))

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Process one message; return the skeletons of tracks."""
        if isinstance(message, StaticTransform | MovingTransform | Odometry):
            self._transforms.add_transform(message)
        elif isinstance(message, CameraInfo):
            if message.camera in self._infos or len(self._infos) < MAX_CAMERAS:
                self._infos[message.camera] = message
        elif isinstance(message, Detections):
            self._detections[message.camera, message.stamp_ns] = message
            if len(self._detections) > FRAMES_MAX:
                del self._detections[next(iter(self._detections))]
        elif isinstance(message, Tracks) and self._is_next(message):
            with span("joints"):
                return self._estimate(message)
        return ()

    def status(self) -> Status:
        """Return the counters."""
        return Status(counters={**self._counters, **self._transforms.counters})

    def _is_next(self, tracks: Tracks) -> bool:
        """Check that tracks are not older than the last; restart after a clock reset."""
        newest_ns = self._newest_ns
        if newest_ns is not None and newest_ns - tracks.stamp_ns > CLOCK_JUMP_NS:
            self._counters["clock_resets"] += 1
            self._newest_ns = None
        elif newest_ns is not None and tracks.stamp_ns < newest_ns:
            self._counters["stale"] += 1
            return False
        return True

    def _estimate(self, tracks: Tracks) -> Sequence[Message]:
        detections = self._detections.pop((tracks.camera, tracks.stamp_ns), None)
        if detections is None:
            self._counters["no_detections"] += 1
            return ()
        info = self._infos.get(tracks.camera)
        if info is None:
            self._counters["no_camera_info"] += 1
            return ()
        stamp_ns, optical = tracks.stamp_ns, detections.frame_id
        pose = self._transforms.camera_pose(tracks.frame_id, optical, stamp_ns)
        if pose is None:
            self._counters["no_transform"] += 1
            return ()
        dt_s = self._time_since(tracks)
        found = self._people(tracks.tracks)
        detected = [detections.at(track.detection) for track in found]
        observation = observe_joints(detected, info, pose)
        people = People.from_tracks(found)
        postures, upright = self._postures.update(dt_s, people, observation)
        states, measured = self._skeletons.estimate_joints(dt_s, people, observation, upright)
        statures = self._skeletons.estimate_statures(people)
        objects = self._objects.update(dt_s, people, observation, postures)
        return [
            Skeletons(
                stamp_ns=stamp_ns,
                sequence=tracks.sequence,
                trace=tracks.trace,
                frame_id=tracks.frame_id,
                camera=tracks.camera,
                people=_skeletons(found, states, measured, postures, statures, objects),
            )
        ]

    def _time_since(self, tracks: Tracks) -> float:
        """Return the time since the last frame; restart after a gap or in another frame."""
        before_ns, self._newest_ns = self._newest_ns, tracks.stamp_ns
        dt_s = 0.0 if before_ns is None else (tracks.stamp_ns - before_ns) / 1e9
        moved, self._frame_id = tracks.frame_id != self._frame_id, tracks.frame_id
        if before_ns is None or moved or dt_s > GAP_MAX_S:
            self._skeletons.restart_skeletons()
            self._postures.restart()
            self._objects.restart()
        return dt_s

    def _people(self, tracks: Sequence[Track]) -> list[Track]:
        """Return the people with a skeleton, without duplicates; count the others."""
        shown = [track for track in tracks if track.state != "tentative"]
        people = list({track.id: track for track in shown}.values())
        self._counters["repeated"] += len(shown) - len(people)
        self._counters["too_many"] += max(len(people) - self._config.people_max, 0)
        return people[: self._config.people_max]


def _skeletons(
    tracks: Sequence[Track],
    states: JointStates,
    measured: Flags,
    postures: Sequence[tuple[Posture, float]],
    statures: tuple[F64, F64],
    objects: Sequence[float],
) -> tuple[PersonSkeleton, ...]:
    positions_m = states.position_m.astype(np.float32)
    covariances_m2 = states.position_m2.astype(np.float32)
    stature_m, sigma_m = (values.tolist() for values in statures)
    return tuple(
        PersonSkeleton(
            id=track.id,
            state=track.state,
            positions_m=positions_m[row],
            covariances_m2=covariances_m2[row],
            measured=tuple(measured[row].tolist()),
            posture=postures[row][0],
            posture_probability=postures[row][1],
            stature_m=stature_m[row],
            stature_sigma_m=sigma_m[row],
            child=_probability_below(CHILD_M, stature_m[row], sigma_m[row]),
            object_like=objects[row],
        )
        for row, track in enumerate(tracks)
    )


def _probability_below(limit: float, mean: float, sigma: float) -> float:
    """Return the probability of a normal variable below a limit."""
    return 0.5 * math.erfc((mean - limit) / sigma / math.sqrt(2))
