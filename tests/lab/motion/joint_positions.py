"""Positions of the joints of a pose, computed from the skeleton independently of the product."""

from dataclasses import dataclass

import numpy as np

from lab.bodies.skeleton import INDEX, Skeleton, map_from_segments
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
    poses = [motion.at(float(t)) for t in times_s]
    turned = np.stack([map_from_segments(pose) for pose in poses], axis=1)
    origin = np.stack([pose.map_from_pelvis[:3, 3] for pose in poses])
    sides = [_joints(origin, turned, skeleton, k) for k in range(2)]
    return Joints(*(np.stack(pair, axis=1) for pair in zip(*sides, strict=True)))


def _joints(origin: F64, turned: F64, skeleton: Skeleton, k: int) -> list[F64]:
    """Return hip, knee, ankle, heel, ball, toe, shoulder and wrist of one side, each Tx3.

    Args:
        origin: Tx3, the pelvis; frame: map.
        turned: SxTx3x3, rotations of the segments; frame: map.
        skeleton: Lengths of the segments.
        k: 0 for left, 1 for right.
    """
    side, pelvis, chest = "lr"[k], turned[INDEX["pelvis"]], turned[INDEX["chest"]]
    hip = origin + pelvis @ skeleton.hip[k]
    knee = hip + turned[INDEX[f"thigh_{side}"]] @ (skeleton.knee[k] - skeleton.hip[k])
    ankle = knee + turned[INDEX[f"shank_{side}"]] @ (skeleton.ankle[k] - skeleton.knee[k])
    foot = turned[INDEX[f"foot_{side}"]]
    sole = [
        ankle + foot @ (point[k] - skeleton.ankle[k])
        for point in (skeleton.heel, skeleton.ball, skeleton.toe)
    ]
    shoulder = origin + pelvis @ skeleton.waist + chest @ (skeleton.shoulder[k] - skeleton.waist)
    upper = turned[INDEX[f"upper_arm_{side}"]] @ (skeleton.elbow[k] - skeleton.shoulder[k])
    lower = turned[INDEX[f"forearm_{side}"]] @ (skeleton.wrist[k] - skeleton.elbow[k])
    return [hip, knee, ankle, *sole, shoulder, shoulder + upper + lower]


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
