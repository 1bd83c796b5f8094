"""Pieces of furniture of scenarios."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from lab.drawing import furniture as built_in
from lab.drawing.furniture import BLACK, STEEL
from lab.drawing.mesh import Material, Mesh, join
from lab.drawing.rooms import Room
from lab.drawing.solids import Finish, box, cylinder, srgb
from lab.furniture import FOOTREST_M, SIZES_M, FurnitureKind, FurniturePlan

PALE = Finish(Material.WOOD, srgb(214, 208, 196))
GREY = Finish(Material.FABRIC, srgb(104, 108, 114))
SEAT_M, BACK_M = 0.46, 0.86  # heights of seat and back of a chair [m]
TOP_M, PARTITION_M, CABINET_M = 0.735, 1.3, 1.15  # heights of desk, partition and cabinet [m]


def furnished(room: Room, furniture: Sequence[FurniturePlan]) -> Room:
    """Return a room with additional pieces of furniture."""
    if not furniture:
        return room
    pieces = [moved(join(KINDS[piece.kind]()), piece.at, piece.yaw_deg) for piece in furniture]
    return replace(room, mesh=join([room.mesh, *pieces]))


def moved(mesh: Mesh, at_m: Sequence[float], yaw_deg: float) -> Mesh:
    """Return a mesh at a position on the floor, turned about the vertical."""
    cos, sin = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([*at_m, 0.0])
    return replace(mesh, vertices_m=mesh.vertices_m @ turn.T + shift, normals=mesh.normals @ turn.T)


@cache
def wheelchair() -> Mesh:
    """Return a wheelchair at the origin that faces +x, with its axle below the hips."""
    seat_m = built_in.SEAT_M + FOOTREST_M
    parts = box((-0.18, -0.22, seat_m - 0.05), (0.28, 0.22, seat_m), BLACK)
    parts += box((-0.22, -0.22, seat_m), (-0.17, 0.22, seat_m + 0.42), BLACK)
    for side in (-1.0, 1.0):
        parts += _wheel(-0.04, side * 0.29, 0.3) + _wheel(0.34, side * 0.22, 0.08)
        for low, high in (
            ((-0.2, 0.23, seat_m + 0.2), (0.2, 0.27, seat_m + 0.23)),  # armrest
            ((-0.32, 0.2, seat_m + 0.4), (-0.2, 0.23, seat_m + 0.43)),  # handle
            ((0.28, 0.18, FOOTREST_M), (0.31, 0.21, seat_m)),
            ((0.28, 0.04, FOOTREST_M - 0.02), (0.58, 0.21, FOOTREST_M)),
        ):
            (x0, y0, z0), (x1, y1, z1) = low, high
            near, far = sorted((side * y0, side * y1))
            parts += box((x0, near, z0), (x1, far, z1), STEEL)
    return join(parts)


def _wheel(x_m: float, y_m: float, radius_m: float) -> list[Mesh]:
    """Return an upright wheel on the floor that rolls along x."""
    lying = cylinder((x_m, radius_m, y_m - 0.015), radius_m, 0.03, BLACK)
    order = [0, 2, 1]
    return [
        replace(part, vertices_m=part.vertices_m[:, order], normals=part.normals[:, order])
        for part in lying
    ]


def _desk() -> list[Mesh]:
    """Return a desk with a screen and a computer."""
    y, x = SIZES_M["desk"][0] / 2, SIZES_M["desk"][1] / 2
    parts = box((-x, -y, TOP_M - 0.03), (x, y, TOP_M), PALE)
    for left in (-x + 0.03, x - 0.07):
        for low in (-y + 0.03, y - 0.07):
            parts += box((left, low, 0.0), (left + 0.04, low + 0.04, TOP_M - 0.03), STEEL)
    parts += box((-0.06, -0.25, TOP_M + 0.10), (-0.02, 0.25, TOP_M + 0.43), BLACK)
    parts += box((-0.05, -0.03, TOP_M), (-0.02, 0.03, TOP_M + 0.12), BLACK)
    parts += box((-0.28, 0.42, TOP_M), (0.16, 0.60, TOP_M + 0.42), BLACK)
    return parts + box((0.06, -0.2, TOP_M), (0.2, 0.2, TOP_M + 0.02), BLACK)


def _chair() -> list[Mesh]:
    half = SIZES_M["chair"][0] / 2
    parts = box((-half, -half, SEAT_M - 0.04), (half, half, SEAT_M), GREY)
    parts += box((-half, -half, SEAT_M + 0.1), (-half + 0.04, half, BACK_M), GREY)
    for x in (-half + 0.02, half - 0.05):
        for y in (-half + 0.02, half - 0.05):
            top = BACK_M if x < 0 else SEAT_M - 0.04
            parts += box((x, y, 0.0), (x + 0.03, y + 0.03, top), STEEL)
    return parts


def _partition() -> list[Mesh]:
    y, x = SIZES_M["partition"][0] / 2, SIZES_M["partition"][1] / 2
    return box((-x, -y, 0.05), (x, y, PARTITION_M), GREY)


def _cabinet() -> list[Mesh]:
    y, x = SIZES_M["cabinet"][0] / 2, SIZES_M["cabinet"][1] / 2
    return box((-x, -y, 0.0), (x, y, CABINET_M), PALE)


KINDS: dict[FurnitureKind, Callable[[], list[Mesh]]] = {
    "desk": _desk,
    "chair": _chair,
    "partition": _partition,
    "cabinet": _cabinet,
}
