"""Put skin, hair and clothes on a figure."""

import numpy as np

from services.camera.lab.cast import Person
from services.camera.lab.colours import linear
from services.camera.lab.face import make_eyes, paint_face
from services.camera.lab.figure import Figure
from services.camera.lab.garments import (
    SKIN_UNDER_M,
    Levels,
    arm_shares,
    make_legwear,
    make_shirt,
    make_shoes,
)
from services.camera.lab.hair import make_hair
from services.camera.lab.materials import Material
from services.camera.lab.surface import Surface


def dress(figure: Figure, person: Person, seed: int) -> list[Surface]:
    """Return all surfaces of a dressed person in the neutral posture.

    Args:
        figure: The body.
        person: What it looks like.
        seed: Of the small differences.
    """
    levels = Levels(figure, person)
    return [
        paint_face(make_skin(figure, person, levels), figure, person),
        *make_hair(figure, person.hair),
        make_eyes(figure, person),
        make_shirt(figure, person.shirt, levels),
        make_legwear(figure, person.legs, levels),
        make_shoes(figure, person.shoes, levels),
    ]


def make_skin(figure: Figure, person: Person, levels: Levels) -> Surface:
    """Return the skin that clothes leave bare, and a little more."""
    z = figure.vertices_m[:, 2]
    arm = arm_shares(figure) > 0.5
    bare = np.where(
        arm,
        z < levels.sleeve + SKIN_UNDER_M,
        (z > levels.neck - 0.10) | (z < levels.legs + SKIN_UNDER_M),
    )
    faces = figure.faces["body"]
    return Surface(
        vertices_m=figure.vertices_m,
        weights=figure.weights,
        colour=np.tile(linear(person.skin), (len(z), 1)),
        faces=faces[bare[faces].any(axis=1)],
        material=Material.SKIN,
    ).compact()
