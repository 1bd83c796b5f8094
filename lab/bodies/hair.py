"""Hair: a shell over the scalp, a curtain of long hair, a beard."""

import numpy as np
import numpy.typing as npt

from lab.bodies.cast import Hair, linear
from lab.bodies.figure import Figure, HeadLandmarks, find_head, on_head
from lab.bodies.garments import cloth
from lab.bodies.surface import BodySurface, cut, grid_faces, smoothed
from lab.drawing.mesh import Material
from people4d.messages import F64

# Height above the eyes by position before the ears, head coordinates
HAIRLINE = np.array(
    [
        [-0.60, -0.88],
        [-0.30, -0.75],
        [-0.12, -0.30],
        [0.05, -0.10],
        [0.20, -0.08],
        [0.36, 0.34],
        [0.58, 0.56],
        [0.75, 0.62],
    ]
)
BALD_ABOVE = 0.30  # upper end of the hair of a balding head, head coordinates
BEARD_TOP = np.array([[0.05, 0.1], [0.25, -0.30], [0.60, -0.66], [0.80, -0.55], [0.95, -0.47]])
BEARD_END = np.array([[0.10, -0.60], [0.40, -1.05], [0.55, -1.25]])
# Lower end of a curtain (head coordinates) by the angle from the front [deg]
CURTAIN_END = {
    "bob": np.array([[64.0, -0.85], [110.0, -1.05], [180.0, -1.10]]),
    "long": np.array(
        [[64.0, -1.05], [110.0, -1.25], [125.0, -1.80], [150.0, -2.15], [180.0, -2.30]]
    ),
}
BACK_DEG = 105.0  # angle from the front of hair that lies on the back [deg]
OFF_BACK_M = 0.024  # distance of long hair from the close-fitting suit [m]
AXIS = -0.10  # position of a curtain's axis before the ears, head coordinates
CURTAIN_FROM_DEG = 64.0  # minimum angle of a curtain from the front [deg]


def make_hair(figure: Figure, hair: Hair) -> list[BodySurface]:
    """Return all hair of a head."""
    pieces = []
    if hair.style != "bald":
        pieces.append(scalp_hair(figure, hair))
    if hair.style in CURTAIN_END:
        pieces.append(curtain(figure, hair))
    if hair.style == "bun":
        pieces.append(bun(figure, hair))
    if hair.beard:
        pieces.append(beard(figure, hair))
    return pieces


def scalp_hair(figure: Figure, hair: Hair) -> BodySurface:
    """Return hair that follows the scalp, thin at the hairline, without ears."""
    head = find_head(figure)
    field = hair_field(head, figure.vertices_m)
    if hair.style == "balding":
        field = np.minimum(field, BALD_ABOVE - head.coordinates(figure.vertices_m)[2])
    field = np.where(on_head(figure), field, -1.0)
    shell = cut(
        cloth(figure, "body", hair.colour, Material.HAIR),
        np.minimum(field, 0.3 - figure.masks["ears"]),
    )
    depth = np.clip(hair_field(head, shell.vertices_m) / 0.45, 0, 1)
    _, _, above = head.coordinates(shell.vertices_m)
    # Shorter at the sides than on the crown
    long = np.clip(0.45 + 0.6 * above, 0.3, 1.0)
    if hair.style == "balding":
        long = long * np.clip((BALD_ABOVE - above) / 0.25, 0, 1)
    return smoothed(shell.inflated(0.0025 + hair.thickness_m * depth * long), 3)


def hair_field(head: HeadLandmarks, vertices_m: F64) -> F64:
    """Return the height of vertices above the hairline, head coordinates."""
    before, beside, above = head.coordinates(vertices_m)
    line = np.interp(before, *HAIRLINE.T)
    # Receding at the temples, with small irregularities
    line = line + 0.10 * np.exp(-(((beside - 0.42) / 0.16) ** 2)) * (before > 0.45)
    return np.asarray(above - line + 0.006 * np.sin(31 * beside + 9 * before))


def curtain(figure: Figure, hair: Hair) -> BodySurface:
    """Return hair that hangs from the sides and the back of the head."""
    head = find_head(figure)
    angle_deg = np.linspace(CURTAIN_FROM_DEG, 360 - CURTAIN_FROM_DEG, 49)
    from_front = np.minimum(angle_deg, 360 - angle_deg)
    end = np.interp(from_front, *CURTAIN_END[hair.style].T)
    down = np.linspace(0, 1, 25)[:, None]
    above = 0.42 + (end - 0.42) * down
    angle = np.radians(angle_deg)[None]
    radius = curtain_radius(figure, head, above, angle)
    # Ends and the edges at the face turn inwards; strands make the surface uneven.
    edge = np.clip((from_front - CURTAIN_FROM_DEG) / 14, 0, 1)
    inward = 0.08 * (1 - edge) ** 2 + 0.10 * np.clip((down - 0.88) / 0.12, 0, 1) ** 2
    radius = radius * (1 - inward) + 0.022 * down * np.sin(11 * angle + 3 * down) * edge
    positions = head.position_m(radius * np.cos(angle) + AXIS, radius * np.sin(angle), above)
    behind = np.broadcast_to(from_front > BACK_DEG, above.shape).ravel()
    vertices = clear_of_back(figure, positions.reshape(-1, 3), behind)
    return BodySurface(
        vertices_m=vertices,
        weights=hanging(figure, vertices),
        colour=np.tile(linear(hair.colour), (len(vertices), 1)),
        faces=grid_faces(25, 49, closed=False)[:, ::-1],
        material=Material.HAIR,
    )


def curtain_radius(figure: Figure, head: HeadLandmarks, above: F64, angle: F64) -> F64:
    """Return the radius of a curtain, head coordinates: an ellipse outside the ears."""
    back = figure.vertices_m[on_head(figure)][:, 0].min()
    beside = head.ear[1] / head.unit_m + 0.16
    behind = (head.ear[0] - back) / head.unit_m + AXIS + 0.06
    ellipse = 1 / np.hypot(np.sin(angle) / beside, np.cos(angle) / behind)
    # The upper end is below the shell.
    up = np.clip(above, 0, 1)
    hidden = np.sqrt(1 - (up / 1.1) ** 2) * (1 - 0.12 * np.clip(up / 0.45, 0, 1))
    return np.asarray(ellipse * hidden)


def clear_of_back(figure: Figure, vertices: F64, behind: npt.NDArray[np.bool_]) -> F64:
    """Return Vx3 vertices [m]; vertices behind are moved backwards out of the clothes."""
    suit = figure.vertices_m[np.unique(figure.faces["tights"])]
    moved = vertices.copy()
    for row in np.flatnonzero(behind):
        x, y, z = vertices[row]
        near = suit[(np.abs(suit[:, 1] - y) < 0.03) & (np.abs(suit[:, 2] - z) < 0.03)]
        if len(near):
            moved[row, 0] = min(x, near[:, 0].min() - OFF_BACK_M)
    return moved


def hanging(figure: Figure, vertices: F64) -> F64:
    """Return weights of hair that moves with the head above and the chest below."""
    neck, head = figure.joints_m["neck"][2], figure.joints_m["head"][2]
    turned = np.clip((vertices[:, 2] - neck + 0.06) / (head - neck + 0.06), 0, 1)
    weights = np.zeros((len(vertices), len(figure.bones)))
    weights[:, figure.bones.index("head")] = turned
    weights[:, figure.bones.index("chest")] = 1 - turned
    return weights


def bun(figure: Figure, hair: Hair) -> BodySurface:
    """Return a knot of hair behind the crown."""
    head = find_head(figure)
    polar = np.linspace(0.02, np.pi - 0.02, 11)[:, None]
    angle = np.linspace(0, 2 * np.pi, 17)[None, :-1]
    ball = 0.34 * np.stack(
        np.broadcast_arrays(
            np.sin(polar) * np.cos(angle), np.sin(polar) * np.sin(angle), 0.9 * np.cos(polar)
        ),
        axis=-1,
    ).reshape(-1, 3)
    vertices = head.position_m(ball[:, 0] - 0.98, ball[:, 1], ball[:, 2] + 0.42)
    weights = np.zeros((len(vertices), len(figure.bones)))
    weights[:, figure.bones.index("head")] = 1.0
    return BodySurface(
        vertices_m=vertices,
        weights=weights,
        colour=np.tile(linear(hair.colour), (len(vertices), 1)),
        faces=grid_faces(11, 16, closed=True)[:, ::-1],
        material=Material.HAIR,
    )


def beard(figure: Figure, hair: Hair) -> BodySurface:
    """Return a full beard without the lips."""
    head = find_head(figure)
    before, _, above = head.coordinates(figure.vertices_m)
    # Lines are defined for lips 0.7 units below the eyes.
    above = above * -0.7 / ((head.mouth[2] - head.eye[2]) / head.unit_m)
    field = np.minimum(
        np.interp(before, *BEARD_TOP.T) - above, above - np.interp(before, *BEARD_END.T)
    )
    field = np.minimum(field, 0.25 - figure.masks["lips"])
    field = np.minimum(field, before - 0.08)
    shell = cut(
        cloth(figure, "body", hair.colour, Material.HAIR), np.where(on_head(figure), field, -1.0)
    )
    return smoothed(shell.inflated(0.006), 1)
