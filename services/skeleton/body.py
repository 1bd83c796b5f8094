"""Human body: joints (COCO), bones and usual pose.

Lengths are means of men and women [Winter 2009]; the pose is upright with hanging arms.
"""

import math
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64, JOINTS

JOINT_COUNT = len(JOINTS)
TORSO = [5, 6, 11, 12]  # shoulders and hips; their mean is the position of a track
# Joints by order of measurement, from the trunk outwards
LEVELS = ([0, 1, 2, 3, 4, 5, 6, 11, 12], [7, 8, 13, 14], [9, 10, 15, 16])
MIRRORED = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15]
LIMBS = ([5, 6, 7, 8, 9, 10], [11, 12, 13, 14, 15, 16])  # arms, legs: pairs exchanged as a whole


@dataclass(frozen=True)
class Bones:
    """Bones without a common joint."""

    first: list[int]  # first joint of each bone
    second: list[int]  # second joint of each bone
    kind: list[int]  # row of BONE_LENGTHS_M, common to left and right


# Shoulders, hips, torso, upper arm, forearm, thigh, shank; head: nose to eye, eyes, eye to ear,
# ears. Last: torso of a person who is not upright (0.46 m bent in simulation).
BONE_LENGTHS_M: F64 = np.array(
    [0.33, 0.19, 0.50, 0.28, 0.25, 0.40, 0.40, 0.05, 0.062, 0.10, 0.15, 0.47]
)
BONE_SIGMA = 0.08  # relative standard deviation of the length between people

_TORSO_BONES = (
    Bones([5, 11, 0, 3], [6, 12, 1, 4], [0, 1, 7, 10]),
    Bones([5, 6, 0, 1], [11, 12, 2, 3], [2, 2, 7, 9]),
    Bones([1, 2], [2, 4], [8, 9]),
)
# Bones between the joints of a level, and to the joints of the level before
BONES: tuple[tuple[Bones, ...], ...] = (
    _TORSO_BONES,
    (Bones([5, 6, 11, 12], [7, 8, 13, 14], [3, 3, 5, 5]),),
    (Bones([7, 8, 13, 14], [9, 10, 15, 16], [4, 4, 6, 6]),),
)

# Positions forward, left and up from the centre of the torso [m]; right joints mirror left joints
_NOSE = (0.15, 0.0, 0.44)
_LEFT = (
    *((0.13, 0.03, 0.47), (0.05, 0.075, 0.45)),  # eye, ear
    *((0.0, 0.17, 0.25), (0.0, 0.24, -0.01), (0.07, 0.26, -0.23)),  # shoulder, elbow, wrist
    *((-0.01, 0.095, -0.25), (0.02, 0.10, -0.64), (-0.08, 0.085, -0.99)),  # hip, knee, ankle
)
# Standard deviations of the positions [m]
_NOSE_SIGMA = (0.06, 0.05, 0.04)
_LEFT_SIGMA = (
    *((0.06, 0.05, 0.04), (0.05, 0.05, 0.04)),
    *((0.03, 0.03, 0.03), (0.10, 0.06, 0.04), (0.18, 0.10, 0.10)),
    *((0.03, 0.03, 0.03), (0.12, 0.05, 0.05), (0.20, 0.06, 0.10)),
)


def _mirrored(nose: tuple[float, ...], left: tuple[tuple[float, ...], ...], side: float) -> F64:
    joints = [nose]
    for x, y, z in left:
        joints += [(x, y, z), (x, side * y, z)]
    return np.array(joints)


USUAL_POSE_M: F64 = _mirrored(_NOSE, _LEFT, -1.0)  # 17x3
USUAL_SIGMA_M: F64 = _mirrored(_NOSE_SIGMA, _LEFT_SIGMA, 1.0)  # 17x3
# Depth of joints behind the surface, along the line of sight [m]
_INSIDE_M = (0.03, 0.05, 0.055, 0.04, 0.025, 0.11, 0.062, 0.05)
INSIDE_M: F64 = np.array([0.012, *np.repeat(_INSIDE_M, 2)])
_AGILITY = (2.0, 2.0, 2.0, 5.0, 10.0, 2.0, 6.0, 10.0)
# Density of white acceleration [m/s^2 sqrt(s)]
AGILITY_MPS2: F64 = np.array([2.0, *np.repeat(_AGILITY, 2)])


def yaw_rotations(yaw_rad: F64) -> F64:
    """Return the rotations (Nx3x3) about the vertical by N angles."""
    found = np.zeros((len(yaw_rad), 3, 3))
    found[:, 0, 0] = found[:, 1, 1] = np.cos(yaw_rad)
    found[:, 1, 0] = np.sin(yaw_rad)
    found[:, 0, 1] = -found[:, 1, 0]
    found[:, 2, 2] = 1.0
    return found


def unturned_pose(pose_m: F64, sigma_m: F64) -> tuple[F64, F64]:
    """Return pose and standard deviations (Nx17x3) of bodies with unknown yaw."""
    wide_m = np.hypot(np.linalg.norm(pose_m[..., :2], axis=-1), sigma_m[..., :2].mean(axis=-1))
    mean_m, spread_m = pose_m.copy(), sigma_m.copy()
    mean_m[..., :2] = 0.0
    spread_m[..., :2] = (wide_m / math.sqrt(2))[..., None]
    return mean_m, spread_m
