"""Rig: bones that move the skin by the segments of a pose, and joints of dressed bodies."""

from dataclasses import dataclass

import numpy as np

from lab.bodies.figure import Figure
from lab.bodies.rotations import about_y
from lab.bodies.skeleton import INDEX, BodyPose, Skeleton, map_from_segments
from lab.drawing.mesh import I32, Material
from people4d.messages import F64

FLOOR_M = 0.03  # maximum depth of a foot on the floor below it [m]
TOE_BEND = 0.7  # maximum bend of the toes [rad]
BALL = 0.69  # position of the ball of the foot, relative to the length from heel to toe
FLEX_M = 0.03  # length of the bending part of a shoe [m]


@dataclass(frozen=True)
class Bone:
    """Bone that turns about a joint with one segment, or with a mean of two segments."""

    parent: str  # bone that carries the joint; empty for the pelvis
    joint: str  # name of the joint; its side is the bone's side
    segment: str  # first segment
    other: str = ""  # second segment
    share: float = 0.0  # weight of the second segment, 0 to 1


def _sided(side: str) -> dict[str, Bone]:
    upper_arm, forearm = f"upper_arm_{side}", f"forearm_{side}"
    thigh, shank, foot = f"thigh_{side}", f"shank_{side}", f"foot_{side}"
    # The girdle turns about the shoulder with a quarter of the arm's rotation.
    return {
        f"shoulder_{side}": Bone("chest", "shoulder", "chest", upper_arm, 0.25),
        upper_arm: Bone("chest", "shoulder", upper_arm),
        f"elbow_{side}": Bone(upper_arm, "elbow", upper_arm, forearm, 0.5),
        forearm: Bone(upper_arm, "elbow", forearm),
        f"hip_{side}": Bone("pelvis", "hip", "pelvis", thigh, 0.5),
        thigh: Bone("pelvis", "hip", thigh),
        f"knee_{side}": Bone(thigh, "knee", thigh, shank, 0.5),
        shank: Bone(thigh, "knee", shank),
        f"ankle_{side}": Bone(shank, "ankle", shank, foot, 0.5),
        foot: Bone(shank, "ankle", foot),
    }


# Parents before children: the bones of the asset in its order, then the toes of shoes
BONES: dict[str, Bone] = {
    "pelvis": Bone("", "", "pelvis"),
    "lumbar": Bone("pelvis", "waist", "pelvis", "chest", 0.5),
    "chest": Bone("pelvis", "waist", "chest"),
    "neck": Bone("chest", "neck", "chest", "head", 0.5),
    "head": Bone("neck", "head", "head"),
    **_sided("l"),
    **_sided("r"),
    **{f"toe_{side}": Bone(f"foot_{side}", "ball", f"foot_{side}") for side in "lr"},
}
NAMES = tuple(BONES)
_FIRST = np.array([INDEX[bone.segment] for bone in BONES.values()])
_OTHER = np.array([INDEX[bone.other or bone.segment] for bone in BONES.values()])
_SHARE = np.array([bone.share for bone in BONES.values()])
_BLENDED = np.flatnonzero(_SHARE)
_TOES = (NAMES.index("toe_l"), NAMES.index("toe_r"))
_PARENT = [NAMES.index(bone.parent) if bone.parent else -1 for bone in BONES.values()]


def joint_positions(joints_m: dict[str, F64]) -> F64:
    """Return the joint of each bone at rest, Bx3; the joint of the pelvis is the origin."""
    positions = np.zeros((len(BONES), 3))
    for index, (name, bone) in enumerate(BONES.items()):
        if bone.joint:
            at = joints_m[bone.joint]
            positions[index] = at if at.ndim == 1 else at["lr".index(name[-1])]
    return positions


def map_from_rest(pose: BodyPose, joints: F64) -> F64:
    """Return the transform of each bone, Bx3x4, from the joints at rest, Bx3, pelvis frame."""
    segments = map_from_segments(pose)
    rotations = segments[_FIRST]
    share = _SHARE[_BLENDED, None, None]
    means = (1 - share) * rotations[_BLENDED] + share * segments[_OTHER[_BLENDED]]
    rotations[_BLENDED] = nearest_rotations(means)
    transforms = np.empty((len(joints), 3, 4))
    transforms[:, :, :3] = rotations
    for bone, parent in enumerate(_PARENT):
        before = transforms[parent] if parent >= 0 else pose.map_from_pelvis[:3]
        at = before[:, :3] @ joints[bone] + before[:, 3]
        transforms[bone, :, 3] = at - rotations[bone] @ joints[bone]
    return transforms


def bend_toes(transforms: F64, joints: F64, tips: F64) -> None:
    """Bend the toes of feet that roll over the floor onto the floor, in place.

    Args:
        transforms: Bx3x4 map_from_rest.
        joints: Joint of each bone at rest, Bx3, pelvis frame.
        tips: Tip of each shoe relative to the ball at rest, 2x3.
    """
    for bone, tip in zip(_TOES, tips, strict=True):
        rotation = transforms[bone, :, :3]
        ball = rotation @ joints[bone] + transforms[bone, :, 3]
        length = np.linalg.norm(tip)
        if not -FLOOR_M < ball[2] < length:
            continue
        sunk = np.arcsin((rotation @ tip)[2] / length)
        bend = np.clip(np.arcsin(-ball[2] / length) - sunk, 0.0, TOE_BEND)
        transforms[bone, :, :3] = rotation @ about_y(-bend)
        transforms[bone, :, 3] = ball - transforms[bone, :, :3] @ joints[bone]


def nearest_rotations(matrices: F64) -> F64:
    """Return the rotations nearest to Nx3x3 means of rotations less than pi apart."""
    u, _, vt = np.linalg.svd(matrices)
    turned = np.linalg.det(u @ vt)
    u[:, :, 2] *= turned[:, None]
    return np.asarray(u @ vt)


def bend_weights(weights: F64, vertices: F64, bones: tuple[str, ...], ball: F64) -> F64:
    """Return weights with two additional columns, toe_l and toe_r, for the tips of the feet.

    Args:
        weights: VxB.
        vertices: Vx3 in the neutral pose.
        bones: B names.
        ball: Balls of the left and the right foot, 2x3.
    """
    extended: F64 = np.concatenate([weights, np.zeros((len(weights), 2))], axis=1)
    for row, side in enumerate("lr"):
        foot = bones.index(f"foot_{side}")
        ahead = np.clip((vertices[:, 0] - ball[row, 0]) / FLEX_M + 0.5, 0, 1)
        extended[:, len(bones) + row] = ahead * weights[:, foot]
        extended[:, foot] *= 1 - ahead
    return extended


def make_skeleton(figure: Figure, vertices: F64, faces: I32, material: I32) -> Skeleton:
    """Return the joints of a dressed body in the neutral pose, with heel and toe of the shoes."""
    joints = figure.joints_m
    shoes = vertices[np.unique(faces[material == Material.SHOE])]
    soles = shoes[shoes[:, 2] < shoes[:, 2].min() + 0.003]
    heel, toe = np.empty((2, 3)), np.empty((2, 3))
    for row, left in enumerate((1.0, -1.0)):
        sole = soles[soles[:, 1] * left > 0]
        heel[row], toe[row] = sole[sole[:, 0].argmin()], sole[sole[:, 0].argmax()]
    return Skeleton(
        hip=joints["hip"],
        knee=joints["knee"],
        ankle=joints["ankle"],
        heel=heel,
        ball=heel + BALL * (toe - heel),
        toe=toe,
        waist=joints["waist"],
        shoulder=joints["shoulder"],
        elbow=joints["elbow"],
        wrist=joints["wrist"],
        stature_m=float(np.ptp(vertices[:, 2])),
    )
