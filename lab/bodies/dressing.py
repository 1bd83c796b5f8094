"""Put skin, hair and clothes on a figure."""

from dataclasses import replace

import numpy as np

from lab.bodies.cast import Person
from lab.bodies.colours import linear
from lab.bodies.face import make_eyes, make_glasses, paint_face
from lab.bodies.figure import Figure
from lab.bodies.garments import (
    Levels,
    collar_field,
    make_legwear,
    make_shirt,
    make_shoes,
    make_socks,
    measure,
    on_arm,
)
from lab.bodies.hair import make_hair
from lab.bodies.surface import Surface
from lab.drawing.materials import Material

KEY_SHADE = 101  # of the random numbers
SHADE = 0.08  # largest relative change of a garment's brightness from seed to seed
UNDER_M = 0.035  # [m] that skin goes on under a hem


def dress(figure: Figure, person: Person, seed: int) -> list[Surface]:
    """Return all surfaces of a dressed person in the neutral posture.

    Args:
        figure: The body.
        person: What it looks like.
        seed: Of the small differences: the shade of clothes and hair.
    """
    levels = measure(figure, person)
    clothes = [
        *make_hair(figure, person.hair),
        make_shirt(figure, person.shirt, levels),
        make_legwear(figure, person.legs, levels),
        make_socks(figure, person.shoes, levels),
        *make_shoes(figure, person.shoes, levels),
    ]
    shades = np.random.default_rng([seed, KEY_SHADE]).uniform(-SHADE, SHADE, 16)
    return [
        make_skin(figure, person, levels),
        make_eyes(figure, person),
        *([make_glasses(figure)] if person.glasses else []),
        *(shaded(piece, shade) for piece, shade in zip(clothes, shades, strict=False)),
    ]


def shaded(piece: Surface, shade: float) -> Surface:
    """Return a piece somewhat brighter or darker."""
    return replace(piece, colour=np.clip(piece.colour * (1 + shade), 0, 1))


def make_skin(figure: Figure, person: Person, levels: Levels) -> Surface:
    """Return the skin that clothes leave bare, and a little more."""
    z = figure.vertices_m[:, 2]
    above_collar = UNDER_M - collar_field(figure, levels.collar)
    trunk = np.maximum(above_collar, levels.legs + UNDER_M - z)
    bare = np.where(on_arm(figure), levels.sleeve + UNDER_M - z, trunk) > 0
    faces = figure.faces["body"]
    skin = Surface(
        vertices_m=figure.vertices_m,
        weights=figure.weights,
        colour=np.tile(linear(person.skin), (len(z), 1)),
        faces=faces[bare[faces].all(axis=1)],
        material=Material.SKIN,
    )
    return paint_face(skin, figure, person).compact()
