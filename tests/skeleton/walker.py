"""Walking person with known joints, and the detections of a camera."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL, apply, invert, project
from people4d.codec import decode, encode
from people4d.messages import F32, F64, CameraInfo, Detections, Message, PersonSkeleton, Skeletons
from services.skeleton.body import INSIDE_M, TORSO, USUAL_POSE_M, yaw_rotations
from services.skeleton.build import build
from services.skeleton.config import SkeletonConfig
from services.skeleton.node import SkeletonNode
from tests.builders import (
    OPTICAL,
    camera_info,
    detection,
    detections,
    static_transform,
    track,
    tracks,
)

INFO: CameraInfo = camera_info()
POSE: F64 = LINK_FROM_OPTICAL.copy()
POSE[2, 3] = 1.2
PERIOD_NS = 50_000_000
LEFT_WRIST, RIGHT_WRIST, LEFT_ELBOW, LEFT_HIP = 9, 10, 7, 11


@dataclass
class Walker:
    """Person in the usual pose, scaled by `size`, walking to the left 3 m from the camera."""

    size: float = 1.0
    yaw_rad: float = np.pi / 2
    swing_m: float = 0.2  # amplitude of the wrists

    def joints_m(self, number: int) -> F64:
        """Return the joints in a frame, 17x3, in the map."""
        pose = self.size * USUAL_POSE_M.copy()
        pose -= pose[TORSO].mean(axis=0)
        swing = self.swing_m * np.sin(number * PERIOD_NS * 1e-9 * 2 * np.pi)
        pose[[LEFT_WRIST, RIGHT_WRIST], 0] += (swing, -swing)
        middle = np.array([3.0, -0.5 + number * PERIOD_NS * 1e-9, 1.2])
        joints: F64 = middle + pose @ yaw_rotations(np.array([self.yaw_rad]))[0].T
        return joints

    def frame(self, number: int, hidden: tuple[int, ...] = (), **fields: Any) -> Detections:
        """Return the detections of a frame; a surface 0.4 m nearer hides some joints."""
        optical_m = apply(invert(POSE), self.joints_m(number))
        keypoints = np.column_stack([project(optical_m, INFO), np.full(17, 0.8)])
        slant = np.linalg.norm(optical_m, axis=1) / optical_m[:, 2]
        depth_m: F32 = (optical_m[:, 2] - INSIDE_M / slant).astype(np.float32)
        depth_m[list(hidden)] -= 0.4
        given = {"keypoints": keypoints.astype(np.float32), "keypoint_depths_m": depth_m}
        found = detection(**{**given, **fields})
        return detections(found, stamp_ns=number * PERIOD_NS, sequence=number)

    def people(self, number: int, **fields: Any) -> Message:
        """Return the tracks of a frame."""
        middle_m = self.joints_m(number)[TORSO].mean(axis=0)
        given = {
            "position_m": middle_m,
            "velocity_mps": np.array([0.0, 1.0, 0.0]),
            "covariance": 1e-3 * np.eye(6),
            "yaw_rad": self.yaw_rad,
            "detection": 0,
        }
        return tracks(track(**{**given, **fields}), stamp_ns=number * PERIOD_NS, sequence=number)


def ready() -> SkeletonNode:
    """Build a node with camera and pose."""
    node = build(SkeletonConfig())
    node.handle(INFO, 0)
    node.handle(static_transform(POSE, OPTICAL), 0)
    return node


def answer(node: SkeletonNode, *messages: Message) -> Skeletons:
    """Return the skeletons of messages, after the codec."""
    (found,) = [one for message in messages for one in node.handle(message, 0)]
    decoded = decode(encode(found))
    assert isinstance(decoded, Skeletons)
    return decoded


def person(found: Skeletons) -> PersonSkeleton:
    """Return the only person."""
    (one,) = found.people
    return one


def errors_m(found: Skeletons, walker: Walker, number: int) -> F64:
    """Return the errors of all joints (17) in metres."""
    apart = person(found).positions_m - walker.joints_m(number)
    return np.asarray(np.linalg.norm(apart, axis=1))
