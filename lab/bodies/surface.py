"""Pieces of skin and cloth in the neutral posture, and cutting them along smooth lines."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lab.bodies.skinning import normals
from lab.drawing.materials import Material, Pattern
from lab.drawing.mesh import I32
from people4d.messages import F64


@dataclass(frozen=True)
class Surface:
    """Coloured triangles of one material that bones will move.

    Args:
        vertices_m: Vx3, pelvis frame, neutral posture.
        weights: VxB shares of the bones.
        colour: Vx3 linear reflectance.
        faces: Fx3 indices of vertices.
        material: Of all triangles.
        pattern: Of all triangles.
    """

    vertices_m: F64
    weights: F64
    colour: F64
    faces: I32
    material: Material
    pattern: Pattern = Pattern.PLAIN

    def compact(self) -> "Surface":
        """Return it without the vertices that no triangle uses."""
        used, faces = np.unique(self.faces, return_inverse=True)
        return self.take(used.astype(np.intp), faces.reshape(-1, 3).astype(np.int32))

    def take(self, vertices: npt.NDArray[np.intp], faces: I32) -> "Surface":
        """Return the vertices of these indices under new triangles."""
        return replace(
            self,
            vertices_m=self.vertices_m[vertices],
            weights=self.weights[vertices],
            colour=self.colour[vertices],
            faces=faces,
        )

    def moved(self, offsets_m: F64) -> "Surface":
        """Return it with vertices moved by Vx3 offsets."""
        return replace(self, vertices_m=self.vertices_m + offsets_m)

    def inflated(self, distance_m: npt.ArrayLike) -> "Surface":
        """Return it with vertices moved outwards by one distance or V distances."""
        distances = np.broadcast_to(np.asarray(distance_m, np.float64), len(self.vertices_m))
        return self.moved(normals(self.vertices_m, self.faces) * distances[:, None])


def cut(surface: Surface, field: F64) -> Surface:
    """Return the part where the field is positive, cut smoothly through the triangles.

    Args:
        surface: What to cut.
        field: V values, linear along edges; vertices with positive values stay.
    """
    inside = field > 0
    corners = inside[surface.faces].sum(axis=1)
    whole = surface.faces[corners == 3]
    # Turn the corner that differs from both others to the front.
    mixed = surface.faces[(corners == 1) | (corners == 2)]
    odd = inside[mixed] == (inside[mixed].sum(axis=1) == 1)[:, None]
    start = odd.argmax(axis=1)
    tip, left, right = (
        np.take_along_axis(mixed, (start[:, None] + step) % 3, axis=1)[:, 0] for step in range(3)
    )
    edges = np.sort(np.concatenate([np.c_[tip, left], np.c_[tip, right]]), axis=1)
    unique, crossing = np.unique(edges, axis=0, return_inverse=True)
    crossing = crossing.reshape(2, -1) + len(field)
    pointed = inside[tip]
    faces = np.concatenate(
        [
            whole,
            np.c_[tip, crossing[0], crossing[1]][pointed],
            np.c_[crossing[0], left, right][~pointed],
            np.c_[crossing[0], right, crossing[1]][~pointed],
        ]
    ).astype(np.int32)
    return (
        with_points(surface, unique, field)
        .take(np.arange(len(field) + len(unique)), faces)
        .compact()
    )


def with_points(surface: Surface, edges: npt.NDArray[np.intp], field: F64) -> Surface:
    """Return the surface with a vertex more on each Ex2 edge, where the field is zero."""
    a, b = edges.T
    share = (field[a] / (field[a] - field[b]))[:, None]

    def between(values: F64) -> F64:
        return np.concatenate([values, values[a] * (1 - share) + values[b] * share])

    return replace(
        surface,
        vertices_m=between(surface.vertices_m),
        weights=between(surface.weights),
        colour=between(surface.colour),
    )


def stack(surfaces: Sequence[Surface]) -> tuple[F64, F64, F64, I32, I32, I32]:
    """Return vertices, weights, colours, faces, materials and patterns of all together."""
    starts = np.cumsum([0, *(len(s.vertices_m) for s in surfaces[:-1])])
    return (
        np.concatenate([s.vertices_m for s in surfaces]),
        np.concatenate([s.weights for s in surfaces]),
        np.concatenate([s.colour for s in surfaces]),
        np.concatenate(
            [s.faces + np.int32(start) for s, start in zip(surfaces, starts, strict=True)]
        ),
        np.concatenate([np.full(len(s.faces), s.material, np.int32) for s in surfaces]),
        np.concatenate([np.full(len(s.faces), s.pattern, np.int32) for s in surfaces]),
    )


def border(faces: I32) -> I32:
    """Return the edges that only one triangle has, Ex2, in the direction of that triangle."""
    directed = np.concatenate([faces[:, [i, (i + 1) % 3]] for i in range(3)])
    _, place, count = np.unique(
        np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    single: I32 = directed[count[place.reshape(-1)] == 1]
    return single


def walls(edges: I32, count: int) -> I32:
    """Return the triangles between edges and their copies, whose indices are `count` higher."""
    a, b = edges.T
    faces = np.concatenate([np.c_[a, a + count, b], np.c_[b, a + count, b + count]])
    return faces.astype(np.int32)


def smoothed(surface: Surface, rounds: int) -> Surface:
    """Return it with each inner vertex drawn towards its neighbours; rims stay."""
    edges = np.sort(np.concatenate([surface.faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    edges = np.unique(edges, axis=0)
    free = np.ones(len(surface.vertices_m), bool)
    free[border(surface.faces)] = False
    both = np.concatenate([edges, edges[:, ::-1]])
    degree = np.bincount(both[:, 0], minlength=len(free))[:, None]
    vertices = surface.vertices_m.copy()
    for _ in range(rounds):
        sums = np.stack(
            [
                np.bincount(both[:, 0], vertices[both[:, 1], axis], minlength=len(free))
                for axis in range(3)
            ],
            axis=1,
        )
        vertices[free] = 0.5 * (vertices + sums / np.maximum(degree, 1))[free]
    return replace(surface, vertices_m=vertices)
