"""The skeleton of a dressed body: joints as baked, heel, ball and toe on the shoe's sole."""

import numpy as np

from lab.bodies.figure import Figure
from lab.drawing.materials import Material
from lab.drawing.mesh import I32
from lab.posture import Skeleton
from people4d.messages import F64

BALL = 0.69  # of the way from heel to toe, where the foot rolls

FLEX_M = 0.03  # length over which a shoe bends


def bend_weights(weights: F64, vertices: F64, bones: tuple[str, ...], ball: F64) -> F64:
    """Return weights with two columns more, toe_l and toe_r, that take the tips of the feet.

    Args:
        weights: VxB.
        vertices: Vx3 in the neutral posture.
        bones: B names.
        ball: 2x3, where the left and the right sole bends.
    """
    extended: F64 = np.concatenate([weights, np.zeros((len(weights), 2))], axis=1)
    for row, side in enumerate("lr"):
        foot = bones.index(f"foot_{side}")
        ahead = np.clip((vertices[:, 0] - ball[row, 0]) / FLEX_M + 0.5, 0, 1)
        extended[:, len(bones) + row] = ahead * weights[:, foot]
        extended[:, foot] *= 1 - ahead
    return extended


def make_skeleton(figure: Figure, vertices: F64, faces: I32, material: I32) -> Skeleton:
    """Return the joints in the neutral posture.

    Args:
        figure: The baked body.
        vertices: Vx3 of the dressed body.
        faces: Fx3.
        material: F.
    """
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
