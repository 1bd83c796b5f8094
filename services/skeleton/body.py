"""The human body: its joints (COCO), the bones between them and its usual pose.

Lengths are those of the mean of men and women [Winter 2009], the pose is upright with arms hanging.
"""

import math
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64, JOINTS

JOINT_COUNT = len(JOINTS)
TORSO = [5, 6, 11, 12]  # shoulders and hips: their mean is the position of a track
# Joints by the order in which they are measured: each follows those that it hangs on.
LEVELS = ([0, 1, 2, 3, 4, 5, 6, 11, 12], [7, 8, 13, 14], [9, 10, 15, 16])
MIRRORED = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15]
LIMBS = ([5, 6, 7, 8, 9, 10], [11, 12, 13, 14, 15, 16])  # exchanged as one: arms, legs


@dataclass(frozen=True)
class Bones:
    """Bones that share no joint."""

    first: tuple[int, ...]  # joint
    second: tuple[int, ...]  # joint
    kind: tuple[int, ...]  # row of BONE_LENGTHS_M: left and right are of one length


# Shoulders, hips, torso, upper arm, forearm, thigh, shank; head: nose to eye, eyes, eye to ear,
# ears.
BONE_LENGTHS_M: F64 = np.array([0.33, 0.19, 0.50, 0.28, 0.25, 0.40, 0.40, 0.05, 0.062, 0.10, 0.15])
BONE_SIGMA = 0.08  # standard deviation between people, of the length

_TORSO_BONES = (
    Bones((5, 11), (6, 12), (0, 1)),
    Bones((5, 6), (11, 12), (2, 2)),
    Bones((0, 3), (1, 4), (7, 10)),
    Bones((0, 1), (2, 3), (7, 9)),
    Bones((1, 2), (2, 4), (8, 9)),
)
# Bones that hold the joints of a level to each other and to those before, in turn.
BONES: tuple[tuple[Bones, ...], ...] = (
    _TORSO_BONES,
    (Bones((5, 6, 11, 12), (7, 8, 13, 14), (3, 3, 5, 5)),),
    (Bones((7, 8, 13, 14), (9, 10, 15, 16), (4, 4, 6, 6)),),
)

# [m] forward, to the left and up from the middle of the torso; left joints, right ones mirror them.
_NOSE = (0.15, 0.0, 0.44)
_LEFT = (
    *((0.13, 0.03, 0.47), (0.05, 0.075, 0.45)),  # eye, ear
    *((0.0, 0.17, 0.25), (0.0, 0.24, -0.01), (0.07, 0.26, -0.23)),  # shoulder, elbow, wrist
    *((-0.01, 0.095, -0.25), (0.02, 0.10, -0.64), (-0.08, 0.085, -0.99)),  # hip, knee, ankle
)
# [m] standard deviations about it, likewise
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
# [m] of joints behind the surface in front of them, along the line of sight
_INSIDE_M = (0.03, 0.05, 0.055, 0.04, 0.025, 0.11, 0.062, 0.05)
INSIDE_M: F64 = np.array([0.012, *np.repeat(_INSIDE_M, 2)])
_AGILITY = (2.0, 2.0, 2.0, 5.0, 10.0, 2.0, 6.0, 10.0)
# [m/s^2] standard deviation of accelerations, of white noise over a second
AGILITY_MPS2: F64 = np.array([2.0, *np.repeat(_AGILITY, 2)])


def turned(yaw_rad: F64) -> F64:
    """Return the rotations about the vertical by N angles, Nx3x3."""
    found = np.zeros((len(yaw_rad), 3, 3))
    found[:, 0, 0] = found[:, 1, 1] = np.cos(yaw_rad)
    found[:, 1, 0] = np.sin(yaw_rad)
    found[:, 0, 1] = -found[:, 1, 0]
    found[:, 2, 2] = 1.0
    return found


def unturned_pose(pose_m: F64, sigma_m: F64) -> tuple[F64, F64]:
    """Return pose and standard deviations (Nx17x3) of bodies of unknown yaw."""
    wide_m = np.hypot(np.linalg.norm(pose_m[..., :2], axis=-1), sigma_m[..., :2].mean(axis=-1))
    mean_m, spread_m = pose_m.copy(), sigma_m.copy()
    mean_m[..., :2] = 0.0
    spread_m[..., :2] = (wide_m / math.sqrt(2))[..., None]
    return mean_m, spread_m
