"""Kinematic model of ROS4HRI's human_description: angles of joints, and the URDF of one body.

The root link `body` is at the centre of the upright torso, x forward and z up, as its frame on /tf.
Limbs point down at angle 0. The torso bends forward only.
"""

import math
from collections.abc import Iterator

import numpy as np

from people4d.messages import F64

# Joints in the order of hri_fullbody
NAMES = (
    *("waist", "r_head", "y_head", "p_head"),
    *("l_y_shoulder", "l_p_shoulder", "l_r_shoulder", "l_elbow"),
    *("r_y_shoulder", "r_p_shoulder", "r_r_shoulder", "r_elbow"),
    *("l_y_hip", "l_p_hip", "l_r_hip", "l_knee", "r_y_hip", "r_p_hip", "r_r_hip", "r_knee"),
)
# Half shoulders, hips, torso, upper arm, forearm, thigh and shank [m]: the proportions of
# human_description for a stature of 1.65 m
LENGTHS_M: F64 = np.array([0.8, 1.2, 2.75, 1.6, 1.0, 1.5, 2.0]) * 1.65 / 7.5
# COCO joints of limbs from the torso outwards, left first
ARMS, LEGS = ((5, 7, 9), (6, 8, 10)), ((11, 13, 15), (12, 14, 16))
SIDES = (("l", 1.0), ("r", -1.0))  # prefix of names, and sign of the y axis
RADIUS_M = 0.03  # radius of limbs in drawings [m]


def bone_lengths(joints_m: F64) -> F64:
    """Return the lengths of LENGTHS_M by 17 joints, for limbs the mean of left and right."""
    shoulders, hips = joints_m[[5, 6]], joints_m[[11, 12]]
    torso_m = np.linalg.norm(shoulders.mean(axis=0) - hips.mean(axis=0))
    bones_m = np.linalg.norm(np.diff(joints_m[np.array([ARMS, LEGS])], axis=2), axis=-1)
    limbs_m = bones_m.mean(axis=1).ravel()
    return np.array([math.dist(*shoulders) / 2, math.dist(*hips), torso_m, *limbs_m])


def joint_angles(joints_m: F64) -> list[float]:
    """Return the angles of NAMES [rad] by 17 joints along the axes of the body."""
    spine = joints_m[[5, 6]].mean(axis=0) - joints_m[[11, 12]].mean(axis=0)
    waist_rad = math.atan2(spine[0], spine[2])
    c, s = math.cos(waist_rad), math.sin(waist_rad)
    upright_m = joints_m @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    angles = [waist_rad, *_head(upright_m)]
    for arm, (_, side) in zip(ARMS, SIDES, strict=True):
        angles += _arm(*_directions(upright_m, arm), side)
    for leg, (_, side) in zip(LEGS, SIDES, strict=True):
        angles += _leg(*_directions(joints_m, leg), side)
    return angles


def urdf(body: str, lengths_m: F64) -> str:
    """Return the URDF of a body; names of links and joints end with its id."""
    parts = [f'<link name="body_{body}"/>']
    for name, parent, child, at_m, axis, bone_m in _joints(lengths_m):
        drawn = (
            f'<visual><origin xyz="0 0 {-bone_m / 2}"/><geometry>'
            f'<cylinder length="{bone_m}" radius="{RADIUS_M}"/></geometry></visual>'
        )
        parts += [
            f'<link name="{child}_{body}">{drawn if bone_m else ""}</link>',
            f'<joint name="{name}_{body}" type="{"continuous" if axis else "fixed"}">'
            f'<parent link="{parent}_{body}"/><child link="{child}_{body}"/>'
            f'<origin xyz="{" ".join(map(str, at_m))}"/>',
            f'<axis xyz="{axis}"/></joint>' if axis else "</joint>",
        ]
    return f'<?xml version="1.0"?><robot name="human_{body}">{"".join(parts)}</robot>'


def _unit(vector: F64) -> F64:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9))


def _directions(joints_m: F64, limb: tuple[int, int, int]) -> tuple[F64, F64]:
    """Return the directions of the upper and the lower bone of a limb."""
    first, second, third = joints_m[list(limb)]
    return _unit(second - first), _unit(third - second)


def _angle(cosine: float) -> float:
    return math.acos(min(max(cosine, -1.0), 1.0))


def _head(joints_m: F64) -> tuple[float, float, float]:
    """Return roll, yaw and pitch of the head by ears and nose."""
    left = _unit(joints_m[3] - joints_m[4])
    ahead = joints_m[0] - joints_m[[3, 4]].mean(axis=0)
    ahead = _unit(ahead - (ahead @ left) * left)
    up = np.cross(ahead, left)
    return math.atan2(left[2], left[1]), -math.asin(left[0]), -math.atan2(up[0], ahead[0])


def _arm(upper: F64, lower: F64, side: float) -> tuple[float, float, float, float]:
    """Return the angles of an arm: rotations about -z, x and z by side, then the elbow's."""
    yaw, raised = math.atan2(upper[0], side * upper[1]), _angle(-upper[2])
    c, s = math.cos(side * yaw), math.sin(side * yaw)
    x, y, z = c * lower[0] - s * lower[1], s * lower[0] + c * lower[1], lower[2]
    c, s = math.cos(side * raised), math.sin(side * raised)
    y, z = c * y + s * z, c * z - s * y
    return yaw, raised, side * math.atan2(y, x), _angle(-z)


def _leg(upper: F64, lower: F64, side: float) -> tuple[float, float, float, float]:
    """Return the angles of a leg: rotations about -z, x by side and -y, then the knee's."""
    bend = (lower @ upper) * upper - lower  # forward: the shank bends backward
    if np.linalg.norm(bend) < 1e-6:
        bend = np.array([1.0, 0.0, 0.0]) - upper[0] * upper
    x, z = _unit(bend), -upper
    y = np.cross(z, x)
    bent = -_angle(float(upper @ lower))
    return math.atan2(y[0], y[1]), side * math.asin(y[2]), math.atan2(x[2], z[2]), bent


def _joints(lengths_m: F64) -> Iterator[tuple[str, str, str, tuple[float, ...], str, float]]:
    """Yield joint, parent, child, origin, axis, and the length of the child's bone, from the root.

    An empty axis is a fixed joint, and a length of 0 draws nothing.
    """
    half, hips, torso, *limbs = lengths_m.round(4).tolist()
    yield "waist", "body", "waist", (0.0, 0.0, -torso / 2), "0 1 0", 0.0
    yield "torso", "waist", "torso", (0.0, 0.0, torso), "", torso
    yield "r_head", "torso", "r_head", (0.0, 0.0, torso / 11), "1 0 0", 0.0
    yield "y_head", "r_head", "y_head", (0.0, 0.0, 0.0), "0 0 1", 0.0
    yield "p_head", "y_head", "p_head", (0.0, 0.0, 0.0), "0 -1 0", 0.0
    yield "head", "p_head", "head", (torso / 11, 0.0, torso / 5.5), "", torso / 4
    for p, s in SIDES:
        arm = "torso", (0.0, s * half, 0.0), ("shoulder", "elbow", "wrist"), f"0 0 {s}"
        leg = "body", (0.0, s * hips / 2, -torso / 2), ("hip", "knee", "ankle"), "0 -1 0"
        for (parent, at_m, (upper, lower, end), roll), (upper_m, lower_m) in (
            (arm, limbs[:2]),
            (leg, limbs[2:]),
        ):
            yaw = f"0 0 {-s}" if parent == "torso" else "0 0 -1"
            names = [f"{p}_{kind}_{upper}" for kind in "ypr"]
            yield names[0], parent, names[0], at_m, yaw, 0.0
            yield names[1], names[0], names[1], (0.0, 0.0, 0.0), f"{s} 0 0", 0.0
            yield names[2], names[1], f"{p}_{upper}", (0.0, 0.0, 0.0), roll, upper_m
            below_m = 0.0, 0.0, -upper_m
            yield f"{p}_{lower}", f"{p}_{upper}", f"{p}_{lower}", below_m, "0 -1 0", lower_m
            yield f"{p}_{end}", f"{p}_{lower}", f"{p}_{end}", (0.0, 0.0, -lower_m), "", 0.0
