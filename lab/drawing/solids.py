"""Boxes, cylinders and panels of a room."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lab.drawing.mesh import Material, Mesh
from people4d.messages import F64

SIDES = 20  # number of sides of a cylinder


@dataclass(frozen=True)
class Finish:
    """Surface of a solid."""

    material: Material
    # linear reflectance, red first, 0 to 1; radiance of a lamp
    colour: tuple[float, float, float]
    # position in the solid texture, different for each board
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


def srgb(red: int, green: int, blue: int) -> tuple[float, float, float]:
    """Return the linear reflectance of an sRGB colour, 0 to 255 each."""
    return ((red / 255) ** 2.2, (green / 255) ** 2.2, (blue / 255) ** 2.2)


def panel(at: npt.ArrayLike, along: npt.ArrayLike, up: npt.ArrayLike, finish: Finish) -> Mesh:
    """Return a parallelogram at a corner [m], with two edges [m]; its normal is along x up."""
    origin, right, top = (np.asarray(edge, np.float64) for edge in (at, along, up))
    points = np.array([origin, origin + right, origin + right + top, origin + top])
    normal = np.cross(right, top)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    normals = np.tile(normal / np.linalg.norm(normal), (4, 1))
    return _mesh(points, normals, faces, finish, points)


def box(low_m: npt.ArrayLike, high_m: npt.ArrayLike, finish: Finish) -> list[Mesh]:
    """Return the six sides of a box along the axes; the grain runs along its longest edge."""
    low, high = np.asarray(low_m, np.float64), np.asarray(high_m, np.float64)
    x, y, z = np.diag(high - low)
    sides = [
        panel(low, y, x, finish),
        panel(low + z, x, y, finish),
        panel(low, x, z, finish),
        panel(low + y, z, x, finish),
        panel(low, z, y, finish),
        panel(low + x, y, z, finish),
    ]
    longest = int(np.argmax(high - low))
    order = [longest, (longest + 1) % 3, (longest + 2) % 3]
    return [_retextured(side, side.vertices_m[:, order] + finish.shift_m) for side in sides]


def cylinder(
    base_m: Sequence[float], radius_m: float, height_m: float, finish: Finish
) -> list[Mesh]:
    """Return an upright cylinder: its wall and its two lids."""
    turns = np.arange(SIDES) * (2 * math.pi / SIDES)
    ring = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(SIDES)])
    base = np.asarray(base_m, np.float64)
    lower, upper = base + ring * radius_m, base + ring * radius_m + (0, 0, height_m)
    i = np.arange(SIDES)
    j = (i + 1) % SIDES
    wall_faces = np.vstack(
        [np.column_stack([i, j, j + SIDES]), np.column_stack([i, j + SIDES, i + SIDES])]
    )
    wall = np.vstack([lower, upper])
    fan = np.column_stack([np.zeros(SIDES - 2, int), i[1:-1], i[2:]])
    up = np.tile([0.0, 0.0, 1.0], (SIDES, 1))
    return [
        _mesh(wall, np.vstack([ring, ring]), wall_faces, finish, wall),
        _mesh(upper, up, fan, finish, upper),
        _mesh(lower, -up, fan[:, ::-1], finish, lower),
    ]


def shaded(mesh: Mesh, colours: npt.ArrayLike) -> Mesh:
    """Return a mesh with other colours of its corners, Vx3."""
    colour = np.asarray(colours, np.float32)
    return replace(mesh, colour=np.ascontiguousarray(colour))


def pictured(mesh: Mesh, width: float, height: float, number: float = 0.0) -> Mesh:
    """Return a panel with a texture of a size; `number` selects an image."""
    u, v, n = width, height, number
    return _retextured(mesh, np.array([[0, 0, n], [u, 0, n], [u, v, n], [0, v, n]]))


def _retextured(mesh: Mesh, texture_m: F64) -> Mesh:
    return replace(mesh, texture_m=np.ascontiguousarray(texture_m, np.float32))


def _mesh(points: F64, normals: F64, faces: npt.ArrayLike, finish: Finish, texture_m: F64) -> Mesh:
    indices = np.ascontiguousarray(faces, np.int32)
    count = len(indices)
    return Mesh(
        vertices_m=np.ascontiguousarray(points),
        normals=np.ascontiguousarray(normals),
        texture_m=np.ascontiguousarray(texture_m + finish.shift_m, np.float32),
        colour=np.tile(np.array(finish.colour, np.float32), (len(points), 1)),
        faces=indices,
        material=np.full(count, finish.material, np.int32),
        pattern=np.zeros(count, np.int32),
        owner=np.zeros(count, np.int32),
    )
