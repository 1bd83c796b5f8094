"""Conversion of anny's rest pose (arms out, elbows bent) to the lab's neutral posture."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

# anny: x left, y backward, z up. Lab: x forward, y left, z up.
CLEAR_M = 0.045  # [m] distance of the wrists from the hips
LEAN = (0.04, 0.25)  # smallest and largest slope of hanging arms
LAB_FROM_ANNY: F64 = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def turn(axis: F64, angle_rad: float) -> F64:
    """Return the rotation about an axis (Rodrigues)."""
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: F64 = np.eye(3) + np.sin(angle_rad) * K + (1 - np.cos(angle_rad)) * K @ K
    return rotation


def align(source: F64, target: F64) -> F64:
    """Return the smallest rotation that brings one direction to another."""
    axis = np.cross(source, target)
    sine = float(np.linalg.norm(axis))
    return np.eye(3) if sine < 1e-12 else turn(axis, float(np.arctan2(sine, source @ target)))


def neutral_rotations(names: Sequence[str], heads: F64, hips_m: float) -> Mapping[str, F64]:
    """Return the rotations of all bones that leave their rest orientation.

    Args:
        names: Names of anny's bones.
        heads: Bx3 rest positions of the bones' heads in metres, lab axes.
        hips_m: Half the width of the hips, at which the arms hang.
    """
    at = dict(zip(names, heads, strict=True))
    rotations: dict[str, F64] = {}
    for side, left in (("L", 1.0), ("R", -1.0)):
        limbs = limb_rotations(at, side, hips_m)
        for name in names:
            if name.endswith("." + side):
                kind = next((kind for kind in limbs if name.startswith(kind)), None)
                if kind:
                    rotations[name] = limbs[kind]
        relax_fingers(rotations, at, side, left)
    return rotations


def limb_rotations(at: Mapping[str, F64], side: str, hips_m: float) -> dict[str, F64]:
    """Return the rotations of one side by the beginning of the bones' names."""

    def along(a: str, b: str) -> F64:
        return at[f"{b}.{side}"] - at[f"{a}.{side}"]

    shoulder_y = at[f"upperarm01.{side}"][1]
    reach_m = sum(
        float(np.linalg.norm(along(*bone)))
        for bone in (("upperarm01", "lowerarm01"), ("lowerarm01", "wrist"))
    )
    lean = (hips_m + CLEAR_M - abs(shoulder_y)) / reach_m
    outward = np.sign(shoulder_y) * np.clip(lean, *LEAN)
    upper_arm = align(along("upperarm01", "lowerarm01"), np.array([-0.03, outward, -1.0]))
    forearm = align(along("lowerarm01", "wrist"), np.array([0.14, 0.8 * outward, -1.0]))
    thigh, shank = along("upperleg01", "lowerleg01"), along("lowerleg01", "foot")
    foot = along("foot", "toe2-1")
    straight = np.array([1.0, 0.0, 1.0])  # without the sideways part
    inward = np.array([0.0, -0.15 * at[f"upperleg01.{side}"][1], 0.0])
    return {
        "upperarm": upper_arm,
        **dict.fromkeys(("lowerarm", "wrist", "finger", "metacarpal"), forearm),
        "upperleg": align(thigh, thigh * straight + inward),
        "lowerleg": align(shank, shank * straight),
        **dict.fromkeys(("foot", "toe"), turn(np.array([0.0, 0.0, 1.0]), yaw_to_front(foot))),
    }


def yaw_to_front(direction: F64) -> float:
    """Return the yaw [rad] that turns a direction to +x."""
    return -float(np.arctan2(direction[1], direction[0]))


def relax_fingers(rotations: dict[str, F64], at: Mapping[str, F64], side: str, left: float) -> None:
    """Curl the fingers of a hanging hand, the little finger most."""
    forearm = rotations[f"wrist.{side}"]
    across = forearm @ (at[f"finger2-1.{side}"] - at[f"finger5-1.{side}"])
    for finger in (2, 3, 4, 5):
        for joint in (1, 2, 3):
            bend_rad = 0.16 + 0.20 * joint + 0.05 * (finger - 2)
            name = f"finger{finger}-{joint}.{side}"
            rotations[name] = turn(across, -left * bend_rad) @ rotations[name]
    thumb = forearm @ (at[f"finger3-1.{side}"] - at[f"wrist.{side}"])
    for joint in (1, 2, 3):
        name = f"finger1-{joint}.{side}"
        rotations[name] = turn(thumb, left * 0.2) @ rotations[name]


def chain(
    rotations: Mapping[str, F64], names: Sequence[str], parents: Sequence[int], heads: F64
) -> F64:
    """Return the 3x4 transforms neutral_from_rest of all bones, with connected joints."""
    transforms = np.empty((len(names), 3, 4))
    for bone, (name, parent) in enumerate(zip(names, parents, strict=True)):
        rotation = rotations.get(name, np.eye(3))
        before = transforms[parent] if parent >= 0 else np.eye(3, 4)
        joint = before[:, :3] @ heads[bone] + before[:, 3]
        transforms[bone, :, :3] = rotation
        transforms[bone, :, 3] = joint - rotation @ heads[bone]
    return transforms


def pose(vertices: F64, weights: F64, transforms: F64) -> F64:
    """Return skinned vertices (linear blend).

    Args:
        vertices: Vx3 in the rest pose.
        weights: VxB.
        transforms: Bx3x4.
    """
    blended = (weights @ transforms.reshape(len(transforms), 12)).reshape(-1, 3, 4)
    posed: F64 = np.einsum("vij,vj->vi", blended[:, :, :3], vertices) + blended[:, :, 3]
    return posed
