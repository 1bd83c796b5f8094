"""Colours of the face, and the eyes."""

from dataclasses import replace

import numpy as np

from common.messages import F64
from services.camera.lab.cast import Person
from services.camera.lab.colours import linear
from services.camera.lab.figure import Figure
from services.camera.lab.materials import Material
from services.camera.lab.surface import Surface

NOSE, EYE, EAR = 0, 1, 3  # COCO; of the pairs the left


class Head:
    """Coordinates of a head, in units of the distance from eyes to crown.

    Args:
        figure: Whose head.
    """

    def __init__(self, figure: Figure) -> None:
        keypoints = figure.keypoint_forms[:, :, :3].sum(axis=1)
        body = figure.vertices_m[np.unique(figure.faces["body"])]
        self.nose, self.eye, self.ear = (keypoints[index] for index in (NOSE, EYE, EAR))
        self.unit_m = float(body[:, 2].max() - self.eye[2])

    def coordinates(self, vertices: F64) -> tuple[F64, F64, F64]:
        """Return how far vertices lie before the ears, beside the middle and above the eyes."""
        x, y, z = vertices.T
        unit = self.unit_m
        return (x - self.ear[0]) / unit, np.abs(y) / unit, (z - self.eye[2]) / unit


def paint_face(skin: Surface, figure: Figure, person: Person) -> Surface:
    """Return skin with brows, lips and cheeks."""
    return skin


def make_eyes(figure: Figure, person: Person) -> Surface:
    """Return both eyeballs with iris and pupil."""
    vertices = figure.vertices_m
    eyes = Surface(
        vertices_m=vertices,
        weights=figure.weights,
        colour=np.full((len(vertices), 3), 0.72),
        faces=figure.faces["eyes"],
        material=Material.EYE,
    ).compact()
    colour = eyes.colour.copy()
    for left in (1.0, -1.0):
        side = eyes.vertices_m[:, 1] * left > 0
        centre = eyes.vertices_m[side].mean(axis=0)
        away = eyes.vertices_m - centre
        radius = np.hypot(away[:, 1], away[:, 2])
        front = side & (away[:, 0] > 0)
        colour[front & (radius < 0.0075)] = linear(person.eyes)
        colour[front & (radius < 0.0035)] = 0.01
    return replace(eyes, colour=colour)
