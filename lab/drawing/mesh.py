"""Triangles and their materials, numbered by the solid textures of the shading."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from people4d.messages import F32, F64

I32 = npt.NDArray[np.int32]


class Material(IntEnum):
    """Materials of surfaces."""

    SKIN = 0
    HAIR = 1
    SHIRT = 2
    TROUSERS = 3
    SHOE = 4
    EYE = 5
    PLANKS = 10
    PAINT = 11
    WOOD = 12
    POSTER = 13
    LAMP = 14
    BOOKS = 15
    FABRIC = 16
    CARPET = 17
    CONCRETE = 18
    METAL = 19
    MIRROR = 20


class Pattern(IntEnum):
    """Patterns of a shirt."""

    PLAIN = 0
    STRIPES = 1
    PLAID = 2
    PRINT = 3
    PLACKET = 4  # row of buttons and fine vertical lines
    BLOCKS = 5  # chest and belly of different brightness


@dataclass(frozen=True)
class Mesh:
    """Coloured triangles."""

    vertices_m: F64  # Vx3, frame: map
    normals: F64  # Vx3, unit length, outward
    # Vx3 positions in the solid texture: position in the room, or in the rest pose of a body
    texture_m: F32
    colour: F32  # Vx3 linear reflectance, red first, 0 to 1
    faces: I32  # Fx3 indices of vertices
    material: I32  # F, see `Material`
    pattern: I32  # F, pattern of cloth, see `Pattern`
    owner: I32  # F, 0: the room, k + 1: person k


def join(meshes: Sequence[Mesh]) -> Mesh:
    """Join meshes, at least one."""
    starts = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes[:-1])])
    moved = [mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts, strict=True)]
    joined = {name: np.concatenate([vars(m)[name] for m in meshes]) for name in vars(meshes[0])}
    return Mesh(**{**joined, "faces": np.concatenate(moved)})
