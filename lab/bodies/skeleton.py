"""Skeleton, and its pose: the rotations of its segments."""

from dataclasses import dataclass

import numpy as np

from people4d.messages import F64

# Segment -> parent; parents before children
PARENTS: dict[str, str] = {
    "pelvis": "",
    "chest": "pelvis",
    "head": "chest",
    "upper_arm_l": "chest",
    "forearm_l": "upper_arm_l",
    "upper_arm_r": "chest",
    "forearm_r": "upper_arm_r",
    "thigh_l": "pelvis",
    "shank_l": "thigh_l",
    "foot_l": "shank_l",
    "thigh_r": "pelvis",
    "shank_r": "thigh_r",
    "foot_r": "shank_r",
}
SEGMENTS = tuple(PARENTS)
INDEX = {name: index for index, name in enumerate(SEGMENTS)}


@dataclass(frozen=True)
class BodyPose:
    """Pose of a body in the room.

    In the neutral pose (all rotations identity) a person stands upright, arms hanging, legs
    straight, toes forward, and the axes of all segments are parallel: x forward, y left, z up.
    """

    map_from_pelvis: F64  # 4x4, origin in the middle of the hip joints
    # 13x3x3 parent_from_segment in the order of SEGMENTS; identity for the pelvis, whose rotation
    # is in map_from_pelvis
    rotations: F64


def map_from_segments(pose: BodyPose) -> F64:
    """Return the rotation of each segment in the map, 13x3x3 in the order of SEGMENTS."""
    rotations = np.empty((len(SEGMENTS), 3, 3))
    for index, (name, parent) in enumerate(PARENTS.items()):
        before = rotations[INDEX[parent]] if parent else pose.map_from_pelvis[:3, :3]
        rotations[INDEX[name]] = before @ pose.rotations[index]
    return rotations


@dataclass(frozen=True)
class Skeleton:
    """Joints of one person in the neutral pose.

    All points are in metres in the pelvis frame; 2x3 arrays hold the left side first.
    """

    hip: F64  # 2x3; the mean is the origin
    knee: F64  # 2x3, below the hip except for a small forward angle of the leg
    ankle: F64  # 2x3
    heel: F64  # 2x3, rearmost point of the shoe's sole
    ball: F64  # 2x3, point of the sole below the ball of the foot, the centre of its roll
    toe: F64  # 2x3, foremost point of the sole
    waist: F64  # 3, joint of chest and pelvis
    shoulder: F64  # 2x3
    elbow: F64  # 2x3
    wrist: F64  # 2x3
    stature_m: float  # height from sole to crown
