"""Positions of the joints of a pose, computed from the skeleton independently of the product."""

from dataclasses import dataclass

import numpy as np

from lab.bodies.skeleton import INDEX, BodyPose, Skeleton, map_from_segments
from lab.motion.motion import PersonMotion
from people4d.messages import F64


@dataclass(frozen=True)
class Joints:
    """Joints over time; TxKx3 in metres, K = left, right; frame: map."""

    hip: F64
    knee: F64
    ankle: F64
    heel: F64
    ball: F64
    toe: F64
    shoulder: F64
    wrist: F64

    @property
    def torso(self) -> F64:
        """Mean of shoulders and hips, Tx3."""
        mean: F64 = (self.shoulder.mean(axis=1) + self.hip.mean(axis=1)) / 2
        return mean


def joints(motion: PersonMotion, skeleton: Skeleton, times_s: F64) -> Joints:
    """Return the joints at some times."""
    rows = [_joints(motion.at(float(t)), skeleton) for t in times_s]
    return Joints(*np.moveaxis(np.array(rows), 1, 0))


def _joints(pose: BodyPose, skeleton: Skeleton) -> list[list[F64]]:
    turned = map_from_segments(pose)
    pelvis, chest = turned[INDEX["pelvis"]], turned[INDEX["chest"]]
    origin = pose.map_from_pelvis[:3, 3]
    waist = origin + pelvis @ skeleton.waist
    points: list[list[F64]] = [[] for _ in range(8)]
    for k, side in enumerate("lr"):
        hip = origin + pelvis @ skeleton.hip[k]
        knee = hip + turned[INDEX[f"thigh_{side}"]] @ (skeleton.knee[k] - skeleton.hip[k])
        ankle = knee + turned[INDEX[f"shank_{side}"]] @ (skeleton.ankle[k] - skeleton.knee[k])
        foot = turned[INDEX[f"foot_{side}"]]
        sole = [
            ankle + foot @ (point[k] - skeleton.ankle[k])
            for point in (skeleton.heel, skeleton.ball, skeleton.toe)
        ]
        shoulder = waist + chest @ (skeleton.shoulder[k] - skeleton.waist)
        upper = turned[INDEX[f"upper_arm_{side}"]] @ (skeleton.elbow[k] - skeleton.shoulder[k])
        lower = turned[INDEX[f"forearm_{side}"]] @ (skeleton.wrist[k] - skeleton.elbow[k])
        for group, point in zip(
            points, [hip, knee, ankle, *sole, shoulder, shoulder + upper + lower], strict=True
        ):
            group.append(point)
    return points


def pitch_deg(upper: F64, lower: F64, yaw_rad: F64) -> F64:
    """Return how far segments lean forward from hanging straight down, seen from the side.

    Args:
        upper: Tx3, with lower the ends of the segment, frame: map.
        lower: Tx3.
        yaw_rad: T, forward.
    """
    down = lower - upper
    ahead = down[:, 0] * np.cos(yaw_rad) + down[:, 1] * np.sin(yaw_rad)
    return np.degrees(np.arctan2(ahead, -down[:, 2]))


def speeds(points: F64, times_s: F64) -> F64:
    """Return the speed of points, (T-1)x..., from T x ... x3."""
    moved = np.diff(points, axis=0)
    return np.asarray(np.linalg.norm(moved, axis=-1) / (times_s[1] - times_s[0]))
