"""BVH file of a walk: bones of constant length, and the rotation of each joint.

Axes as in TRC: x ahead in the map, y up, z to its right; at rest the person faces x. Lengths are in
centimetres. A joint in a gap is interpolated; a joint without positions is at its parent.
"""

import warnings
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from evaluation.gait.motion import JointMotion
from people4d.messages import F64
from people4d.messages.skeleton import JOINTS

ORDER: Final = "ZXY"  # Order of the intrinsic rotations
TINY_CM = 1e-6  # Length of unknown bones, which need a direction [cm]
UP, DOWN, LEFT, RIGHT, HERE = np.array([(0, 1, 0), (0, -1, 0), (0, 0, -1), (0, 0, 1), (0, 0, 0)])
# Parent and direction at rest, depth first. `torso` and `head` turn the bones above their parents.
TREE = {
    "hips": ("", HERE),
    "left_hip": ("hips", LEFT),
    "left_knee": ("left_hip", DOWN),
    "left_ankle": ("left_knee", DOWN),
    "right_hip": ("hips", RIGHT),
    "right_knee": ("right_hip", DOWN),
    "right_ankle": ("right_knee", DOWN),
    "torso": ("hips", HERE),
    "neck": ("torso", UP),
    "left_shoulder": ("neck", LEFT),
    "left_elbow": ("left_shoulder", DOWN),
    "left_wrist": ("left_elbow", DOWN),
    "right_shoulder": ("neck", RIGHT),
    "right_elbow": ("right_shoulder", DOWN),
    "right_wrist": ("right_elbow", DOWN),
    "head": ("neck", HERE),
    "ears": ("head", UP),
}
# First child of each joint that has children
FIRST = {parent: name for name, (parent, _) in reversed(TREE.items()) if parent}


def bvh(motion: JointMotion) -> str:
    """Return the BVH file of a motion."""
    points = _positions_cm(motion)
    with warnings.catch_warnings(action="ignore"):  # angles at 90 degrees are ambiguous, not wrong
        angles = [one.as_euler(ORDER, degrees=True) for one in _rotations(points)]
    rows = np.concatenate([points["hips"], *angles], axis=1)
    frames = [" ".join(f"{value:.4f}" for value in row) for row in rows]
    header = ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {1 / motion.rate_hz:.7f}"]
    return "\n".join(["HIERARCHY", *_joint("hips", "", points), *header, *frames]) + "\n"


def _joint(name: str, indent: str, points: Mapping[str, F64]) -> Iterator[str]:
    """Yield the lines of a joint and the joints below."""
    parent, rest = TREE[name]
    offset = rest * np.linalg.norm(points[name] - points[parent or name], axis=1).mean()
    turns = " ".join(f"{axis}rotation" for axis in ORDER)
    moves = "" if parent else "Xposition Yposition Zposition "
    yield indent + (f"{'JOINT' if parent else 'ROOT'} {name}" if name in FIRST else "End Site")
    yield f"{indent}{{"
    yield f"{indent}  OFFSET {' '.join(f'{value:.4f}' for value in offset)}"
    if name in FIRST:
        yield f"{indent}  CHANNELS {6 if moves else 3} {moves}{turns}"
    for child in (child for child, (above, _) in TREE.items() if above == name):
        yield from _joint(child, indent + "  ", points)
    yield f"{indent}}}"


def _rotations(points: Mapping[str, F64]) -> Iterator[Rotation]:
    """Yield the rotations of all joints with children, relative to their parents."""
    turned = dict[str, Rotation]()  # rotations from the map, by joint
    for name, (parent, _) in TREE.items():
        if not parent:
            right = points["right_hip"] - points["left_hip"]
            if not right.any():  # a hip is unknown
                right = points["right_shoulder"] - points["left_shoulder"]
            right = right + TINY_CM * RIGHT
            ahead = np.cross(points["neck"] - points["hips"] + TINY_CM * UP, right)
            axes = np.stack([ahead, np.cross(right, ahead), right], axis=2)
            turned[name] = Rotation.from_matrix(axes / np.linalg.norm(axes, axis=1, keepdims=True))
            yield turned[name]
        elif name in FIRST:
            child, before = FIRST[name], turned[parent]
            local = _shortest(TREE[child][1], before.inv().apply(points[child] - points[name]))
            turned[name] = before * local
            yield local


def _shortest(rest: F64, vectors: F64) -> Rotation:
    """Return the shortest rotations of a direction at rest to vectors, Tx3."""
    axes = np.cross(rest, vectors)
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    units = np.where(lengths > TINY_CM, axes / np.maximum(lengths, TINY_CM), (1.0, 0.0, 0.0))
    return Rotation.from_rotvec(units * np.arctan2(lengths[:, 0], vectors @ rest)[:, None])


def _positions_cm(motion: JointMotion) -> dict[str, F64]:
    """Return the positions of all joints, Tx3, y up.

    The middle of a pair with one unknown joint is the known one. If both hips are unknown, the root
    is halfway from shoulders to knees, or the mean of the known joints. Any other unknown joint is
    at its parent.
    """
    at = {
        name: _filled(100 * motion.joints_m[:, k][:, (0, 2, 1)] * (1.0, 1.0, -1.0))
        for k, name in enumerate(JOINTS)
    }
    known = [one for one in at.values() if np.isfinite(one).all()] or [np.zeros(3)]
    ears, neck, hips, knees = (
        _middle(at[f"left_{name}"], at[f"right_{name}"])
        for name in ("ear", "shoulder", "hip", "knee")
    )
    at["ears"], at["neck"], at["head"] = ears, neck, neck
    at["hips"] = _known_or(_known_or(hips, _middle(neck, knees)), np.mean(known, axis=0))
    at["torso"] = at["hips"]
    for name, (parent, _) in TREE.items():
        at[name] = _known_or(at[name], at[parent or name])
    return at


def _middle(first: F64, second: F64) -> F64:
    """Return the points halfway, or the known ones where the others are unknown."""
    return (_known_or(first, second) + _known_or(second, first)) / 2


def _known_or(points: F64, others: F64) -> F64:
    """Return points, or others where they are unknown."""
    return np.where(np.isfinite(points), points, others)


def _filled(points: F64) -> F64:
    """Return positions (Tx3) interpolated in gaps and constant at the ends; NaN if unknown."""
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    if not len(known):
        return points
    frames = np.arange(len(points))
    return np.stack([np.interp(frames, known, points[known, k]) for k in range(3)], axis=1)
