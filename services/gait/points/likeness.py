"""How like the reference the spin images of particles are."""

from collections.abc import Sequence

import numpy as np

from people4d.messages import F64
from services.gait.points.config import DepthLayerConfig
from services.gait.points.point_filter import PointFilter
from services.gait.surface.mesh import Surface
from services.gait.surface.spin_image import similarity, spin_images


def reference(
    point: PointFilter, vertex: int, surface: Surface, config: DepthLayerConfig
) -> F64 | None:
    """Return the spin image that a point is followed by; None if it is not by one.

    Combined, those are marked points that end no limb: limbs bend, and are followed by distances;
    what is rigid, the trunk, is known again by its spin image.
    """
    if config.feature == "geodesic" or (config.feature == "combined" and point.kind):
        return None
    image: F64 = spin_images(surface, [vertex], config.spin)[0]
    return image


def likeness(
    points: Sequence[PointFilter], surface: Surface, config: DepthLayerConfig
) -> list[F64 | None]:
    """Return how like their points' references the spin images of all particles are."""
    vertices = [point.vertices for point in points if point.spin is not None]
    if not vertices:
        return [None] * len(points)
    distinct = np.unique(np.concatenate([[-1], *vertices]))
    images = spin_images(surface, distinct, config.spin)
    found: list[F64 | None] = []
    for point in points:
        if point.spin is None:
            found.append(None)
            continue
        rows, back = np.unique(point.vertices, return_inverse=True)
        alike = similarity(images[np.searchsorted(distinct, rows)], point.spin)
        found.append(alike[back])
    return found
