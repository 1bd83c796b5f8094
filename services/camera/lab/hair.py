"""Hair: a shell over the scalp, and more of it for long hair."""

import numpy as np

from common.messages import F64
from services.camera.lab.cast import Hair
from services.camera.lab.colours import linear
from services.camera.lab.face import Head
from services.camera.lab.figure import Figure
from services.camera.lab.materials import Material
from services.camera.lab.surface import Surface, cut, smoothed

# Height of the hairline (above the eyes) over the place before the ears, in units of the head.
HAIRLINE = np.array(
    [
        [-2.0, -0.85],
        [-0.30, -0.80],
        [-0.12, -0.30],
        [0.05, -0.12],
        [0.22, -0.05],
        [0.34, 0.30],
        [0.55, 0.58],
    ]
)
EAR_M = 0.040  # [m] around the ear that short hair leaves free


def make_hair(figure: Figure, hair: Hair) -> list[Surface]:
    """Return the hair of the head, none if bald."""
    if hair.style == "bald":
        return []
    return [scalp(figure, hair)]


def scalp(figure: Figure, hair: Hair) -> Surface:
    """Return hair that follows the scalp, thin at its line."""
    head = Head(figure)
    before, _, above = head.coordinates(figure.vertices_m)
    field = above - np.interp(before, *HAIRLINE.T)
    field = np.minimum(field, ear_distance(figure.vertices_m, head) / head.unit_m)
    whole = Surface(
        vertices_m=figure.vertices_m,
        weights=figure.weights,
        colour=np.tile(linear(hair.colour), (len(field), 1)),
        faces=figure.faces["body"],
        material=Material.HAIR,
    )
    on_head = figure.weights[:, [figure.bones.index(b) for b in ("neck", "head")]].sum(axis=1)
    shell = cut(whole, np.where(on_head > 0.5, field, -1.0))
    depth = np.clip(
        head.coordinates(shell.vertices_m)[2]
        - np.interp(head.coordinates(shell.vertices_m)[0], *HAIRLINE.T),
        0,
        None,
    )
    return smoothed(shell.inflated(0.002 + hair.thickness_m * np.clip(depth / 0.5, 0, 1)), 3)


def ear_distance(vertices: F64, head: Head) -> F64:
    """Return the distance from the rim of hair around the nearer ear, in metres."""
    mirrored = vertices * np.array([1.0, -1.0, 1.0])
    nearest = np.minimum(*(np.linalg.norm(v - head.ear, axis=1) for v in (vertices, mirrored)))
    distance: F64 = nearest - EAR_M
    return distance
