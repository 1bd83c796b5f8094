"""Thin tubes along lines."""

from collections.abc import Sequence

import numpy as np

from lab.bodies.surface import Surface
from lab.drawing.materials import Material
from lab.drawing.mesh import I32
from people4d.messages import F64

SIDES = 5


def grid_faces(rows: int, columns: int, closed: bool) -> I32:
    """Return the triangles of a grid of vertices.

    Args:
        rows: Of vertices.
        columns: Of vertices, counted first.
        closed: Whether the last column joins the first.
    """
    down = np.arange(rows - 1)[:, None] * columns
    along = np.arange(columns if closed else columns - 1)[None]
    a, b = down + along, down + (along + 1) % columns
    c, d = a + columns, b + columns
    triangles = np.stack([np.stack([a, b, c], -1), np.stack([b, d, c], -1)], 2)
    return triangles.reshape(-1, 3).astype(np.int32)


def tubes(lines: Sequence[F64], radius_m: float, weights: F64, material: Material) -> Surface:
    """Return dark tubes around lines of points.

    Args:
        lines: Each Nx3.
        radius_m: Of the tubes.
        weights: B shares of the bones, the same for all.
        material: Of the tubes.
    """
    vertices, faces, start = [], [], 0
    angle = np.arange(SIDES) / SIDES * 2 * np.pi
    for line in lines:
        along = np.gradient(line, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        # Any direction that is not along the line will do.
        other = np.where(np.abs(along[:, :1]) < 0.7, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        u = np.cross(along, other)
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        w = np.cross(along, u)
        ring = np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * w[:, None]
        vertices.append((line[:, None] + radius_m * ring).reshape(-1, 3))
        faces.append(grid_faces(len(line), SIDES, closed=True) + np.int32(start))
        start += len(line) * SIDES
    places = np.concatenate(vertices)
    return Surface(
        vertices_m=places,
        weights=np.tile(weights, (len(places), 1)),
        colour=np.full(places.shape, 0.02),
        faces=np.concatenate(faces),
        material=material,
    )
