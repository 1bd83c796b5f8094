"""Pieces of furniture of scenarios."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lab.drawing.furniture import BLACK, STEEL
from lab.drawing.mesh import Material, Mesh, join
from lab.drawing.rooms import Room
from lab.drawing.solids import Finish, box, srgb
from lab.furniture import SIZES_M, FurnitureKind, FurniturePlan

PALE = Finish(Material.WOOD, srgb(214, 208, 196))
GREY = Finish(Material.FABRIC, srgb(104, 108, 114))
SEAT_M, BACK_M = 0.46, 0.86  # heights of seat and back of a chair [m]
TOP_M, PARTITION_M, CABINET_M = 0.735, 1.3, 1.15  # heights of desk, partition and cabinet [m]


def furnished(room: Room, furniture: Sequence[FurniturePlan]) -> Room:
    """Return a room with additional pieces of furniture."""
    if not furniture:
        return room
    pieces = [_put(join(KINDS[piece.kind]()), piece) for piece in furniture]
    return replace(room, mesh=join([room.mesh, *pieces]))


def _put(mesh: Mesh, piece: FurniturePlan) -> Mesh:
    cos, sin = math.cos(math.radians(piece.yaw_deg)), math.sin(math.radians(piece.yaw_deg))
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([*piece.at, 0.0])
    return replace(mesh, vertices_m=mesh.vertices_m @ turn.T + shift, normals=mesh.normals @ turn.T)


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
