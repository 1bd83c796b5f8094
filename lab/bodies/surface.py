"""Pieces of skin and cloth in the neutral pose, and smooth cuts through them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lab.bodies.skinning import normals
from lab.drawing.mesh import I32, Material, Pattern
from people4d.messages import F64

SIDES = 5


@dataclass(frozen=True)
class BodySurface:
    """Coloured triangles of one material, with weights of bones."""

    vertices_m: F64  # Vx3, pelvis frame, neutral pose
    weights: F64  # VxB shares of the bones
    colour: F64  # Vx3 linear reflectance
    faces: I32  # Fx3 indices of vertices
    material: Material  # material of all triangles
    pattern: Pattern = Pattern.PLAIN  # pattern of all triangles

    def compact(self) -> "BodySurface":
        """Return the surface without unused vertices."""
        used, faces = np.unique(self.faces, return_inverse=True)
        return self.select_vertices(used.astype(np.intp), faces.reshape(-1, 3).astype(np.int32))

    def select_vertices(self, vertices: npt.NDArray[np.intp], faces: I32) -> "BodySurface":
        """Return a selection of vertices with new triangles."""
        return replace(
            self,
            vertices_m=self.vertices_m[vertices],
            weights=self.weights[vertices],
            colour=self.colour[vertices],
            faces=faces,
        )

    def moved(self, offsets_m: F64) -> "BodySurface":
        """Return the surface with vertices moved by Vx3 offsets."""
        return replace(self, vertices_m=self.vertices_m + offsets_m)

    def inflated(self, distance_m: npt.ArrayLike) -> "BodySurface":
        """Return the surface with vertices moved outwards by one distance or V distances."""
        distances = np.broadcast_to(np.asarray(distance_m, np.float64), len(self.vertices_m))
        return self.moved(normals(self.vertices_m, self.faces) * distances[:, None])


def cut(surface: BodySurface, field: F64) -> BodySurface:
    """Return the part with positive values of a field (V), cut smoothly through the triangles."""
    inside = field > 0
    corners = inside[surface.faces].sum(axis=1)
    inner_faces = surface.faces[corners == 3]
    # Rotate each mixed triangle so that its odd corner comes first.
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
            inner_faces,
            np.c_[tip, crossing[0], crossing[1]][pointed],
            np.c_[crossing[0], left, right][~pointed],
            np.c_[crossing[0], right, crossing[1]][~pointed],
        ]
    ).astype(np.int32)
    return (
        with_points(surface, unique, field)
        .select_vertices(np.arange(len(field) + len(unique)), faces)
        .compact()
    )


def with_points(surface: BodySurface, edges: npt.NDArray[np.intp], field: F64) -> BodySurface:
    """Return the surface with an additional vertex on each of Ex2 edges, at a zero of the field."""
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


def stack(surfaces: Sequence[BodySurface]) -> tuple[F64, F64, F64, I32, I32, I32]:
    """Return joined vertices, weights, colours, faces, materials and patterns."""
    starts = np.cumsum([0, *(len(s.vertices_m) for s in surfaces[:-1])])
    moved = [s.faces + np.int32(start) for s, start in zip(surfaces, starts, strict=True)]
    return (
        np.concatenate([s.vertices_m for s in surfaces]),
        np.concatenate([s.weights for s in surfaces]),
        np.concatenate([s.colour for s in surfaces]),
        np.concatenate(moved),
        np.concatenate([np.full(len(s.faces), s.material, np.int32) for s in surfaces]),
        np.concatenate([np.full(len(s.faces), s.pattern, np.int32) for s in surfaces]),
    )


def border(faces: I32) -> I32:
    """Return the edges of only one triangle, Ex2, in the direction of the triangle."""
    directed = np.concatenate([faces[:, [i, (i + 1) % 3]] for i in range(3)])
    _, edge_index, count = np.unique(
        np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return np.asarray(directed[count[edge_index.reshape(-1)] == 1])


def walls(edges: I32, count: int) -> I32:
    """Return the triangles between edges and their copies, with indices higher by `count`."""
    a, b = edges.T
    faces = np.concatenate([np.c_[a, a + count, b], np.c_[b, a + count, b + count]])
    return faces.astype(np.int32)


def smoothed(surface: BodySurface, rounds: int) -> BodySurface:
    """Return the surface with inner vertices moved towards their neighbours."""
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


def grid_faces(rows: int, columns: int, closed: bool) -> I32:
    """Return the triangles of a grid of vertices by row; closed: columns form a ring."""
    down = np.arange(rows - 1)[:, None] * columns
    along = np.arange(columns if closed else columns - 1)[None]
    a, b = down + along, down + (along + 1) % columns
    c, d = a + columns, b + columns
    triangles = np.stack([np.stack([a, b, c], -1), np.stack([b, d, c], -1)], 2)
    return triangles.reshape(-1, 3).astype(np.int32)


def tubes(lines: Sequence[F64], radius_m: float, weights: F64, material: Material) -> BodySurface:
    """Return dark tubes around lines of points, Nx3 each, with constant weights of bones."""
    vertices, faces, start = [], [], 0
    angle = np.arange(SIDES) / SIDES * 2 * np.pi
    for line in lines:
        along = np.gradient(line, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        # Any direction except along the line
        other = np.where(np.abs(along[:, :1]) < 0.7, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        u = np.cross(along, other)
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        w = np.cross(along, u)
        ring = np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * w[:, None]
        vertices.append((line[:, None] + radius_m * ring).reshape(-1, 3))
        faces.append(grid_faces(len(line), SIDES, closed=True) + np.int32(start))
        start += len(line) * SIDES
    positions = np.concatenate(vertices)
    return BodySurface(
        vertices_m=positions,
        weights=np.tile(weights, (len(positions), 1)),
        colour=np.full(positions.shape, 0.02),
        faces=np.concatenate(faces),
        material=material,
    )
