"""Colours of the face, the eyes, and glasses."""

from dataclasses import replace

import numpy as np

from lab.bodies.cast import CastMember, linear
from lab.bodies.figure import Figure, HeadLandmarks, find_head
from lab.bodies.surface import BodySurface, tubes
from lab.drawing.mesh import Material
from people4d.messages import F64

# Colours relative to the skin
LIPS = np.array([0.90, 0.64, 0.62])
LIDS = np.array([0.42, 0.36, 0.34])
CHEEKS = np.array([1.04, 0.90, 0.88])
IRIS_M, PUPIL_M = 0.0068, 0.0030  # radii [m]


def paint_face(skin: BodySurface, figure: Figure, person: CastMember) -> BodySurface:
    """Return skin, all vertices of the figure, with brows, lips, cheeks and shaded sockets."""
    head = find_head(figure)
    before, beside, above = head.coordinates(skin.vertices_m)
    front = before > 0.35
    colour = skin.colour.copy()
    cheek = front * bump(np.hypot(beside - 0.38, above + 0.42), 0.28)
    colour = tint(colour, cheek, colour * CHEEKS)
    socket = front * bump(np.hypot(beside - 0.28, (above + 0.02) * 1.6), 0.24)
    colour = tint(colour, 0.35 * socket, colour * 0.6)
    colour = tint(colour, figure.masks["lips"], colour * LIPS)
    colour = tint(colour, figure.masks["eyelids"], colour * LIDS)
    under = skin.vertices_m - head.nose - (-0.012, 0.0, -0.013)
    nostrils = bump(np.linalg.norm(under / (0.014, 0.020, 0.008), axis=1), 1.0)
    colour = tint(colour, nostrils, colour * LIDS)
    arch = above - 0.175 - 0.06 * np.sin(np.clip((beside - 0.10) / 0.42, 0, 1) * 2.4)
    brow = front * bump(arch, 0.085) * ((beside > 0.11) & (beside < 0.50))
    return replace(skin, colour=tint(colour, 0.75 * brow, 0.9 * linear(person.hair.colour)))


def bump(distance: F64, width: float) -> F64:
    """Return a smooth bump: 1 at distance 0, 0 beyond the width."""
    inner = np.clip(1 - (distance / width) ** 2, 0, 1)
    return inner * inner


def tint(colour: F64, share: F64, other: F64) -> F64:
    """Mix colours with a share of other colours."""
    return np.asarray(colour + share[:, None] * (other - colour))


def make_eyes(figure: Figure, person: CastMember) -> BodySurface:
    """Return both eyeballs with iris and pupil."""
    vertices = figure.vertices_m
    eyes = BodySurface(
        vertices_m=vertices,
        weights=figure.weights,
        colour=np.full((len(vertices), 3), 0.55),
        faces=figure.faces["eyes"],
        material=Material.EYE,
    ).compact()
    colour = eyes.colour.copy()
    for left in (1.0, -1.0):
        side = eyes.vertices_m[:, 1] * left > 0
        away = eyes.vertices_m - eyes.vertices_m[side].mean(axis=0)
        radius = np.hypot(away[:, 1], away[:, 2])
        front = side & (away[:, 0] > 0)
        colour[front & (radius < IRIS_M)] = linear(person.eyes)
        colour[front & (radius < PUPIL_M)] = 0.01
    return replace(eyes, colour=colour)


def make_glasses(figure: Figure) -> BodySurface:
    """Return the frame of glasses: two rims, a bridge, two temples."""
    head = find_head(figure)
    lines = [*rims(head), *bars(head)]
    weights = np.zeros(len(figure.bones))
    weights[figure.bones.index("head")] = 1.0
    return tubes(lines, 0.0015, weights, Material.SHOE)


def rims(head: HeadLandmarks) -> list[F64]:
    """Return the lines of both rims, closed."""
    angle = np.linspace(0, 2 * np.pi, 17)
    centre = head.eye + np.array([0.026, 0.0, -0.004])
    rim = centre + np.stack(
        [-0.004 * np.abs(np.cos(angle)), 0.023 * np.cos(angle), 0.018 * np.sin(angle)], axis=1
    )
    return [rim, rim * (1.0, -1.0, 1.0)]


def bars(head: HeadLandmarks) -> list[F64]:
    """Return the lines of bridge and temples."""
    x, y, z = head.eye
    side = head.ear[1] + 0.004
    bridge = np.array([[x + 0.026, y - 0.023, z], [x + 0.026, 0.023 - y, z]])
    hinge = (x + 0.014, side - 0.008, z + 0.004)
    temple = np.array([(x + 0.022, y + 0.023, z), hinge, (head.ear[0], side, z + 0.002)])
    return [bridge, temple, temple * (1.0, -1.0, 1.0)]
