"""Geodesic distances along the mesh of a body, and their extrema: the ends of its limbs.

Source: docs/method.md, sections 8.3 (G 4.3) and 19 [Plagemann 2010].
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from common.compiled import compiled
from people4d.messages import F64
from services.gait.surface.mesh import BodyMesh
from services.gait.surface.segmentation import I32, I64

PERSISTENCE_M = 0.06  # Minimum persistence of an extremity [m]


def geodesic_m(mesh: BodyMesh, source_vertex: npt.ArrayLike) -> F64:
    """Return the lengths (V) of the shortest paths to a source along the mesh [Dijkstra 1959].

    With several sources the nearest counts; unconnected vertices are at infinity.
    """
    count = len(mesh.points_m)
    sources = np.atleast_1d(np.asarray(source_vertex, np.int64))
    sources = sources[(sources >= 0) & (sources < count)]
    if not len(sources):
        return np.full(count, np.inf)
    graph = csr_array((mesh.lengths_m, mesh.indices, mesh.indptr), shape=(count, count))
    found = dijkstra(graph, directed=True, indices=sources, min_only=True)
    return np.asarray(found, np.float64)


@dataclass(frozen=True, kw_only=True)
class GeodesicExtrema:
    """T local maxima of the geodesic distance, farthest first."""

    vertices: I64  # T
    persistence_m: F64  # T: height above the point at which its basin meets a higher one
    basin: I32  # V: number of the extremum that a vertex leads up to; -1: not connected

    @property
    def strengths(self) -> F64:
        """Persistence of the extrema, T: 0 to 1 (0.2 m)."""
        return np.minimum(self.persistence_m / 0.2, 1.0)


def geodesic_extrema(
    mesh: BodyMesh, distance_m: F64, persistence_m: float = PERSISTENCE_M
) -> GeodesicExtrema:
    """Find the ends of limbs: local maxima of the geodesic distance (V) of enough persistence.

    The surface is flooded from the farthest vertex down. Each local maximum begins an island; if
    two islands meet, the lower one is a limb if its persistence suffices, else noise.
    """
    height = np.where(np.isfinite(distance_m), distance_m, -np.inf)
    reached = int(np.isfinite(distance_m).sum())
    order = np.argsort(-height, kind="stable")[:reached]
    basin = np.full(len(height), -1, np.int32)
    persistence = np.zeros(len(height))
    _flood(order, height, mesh.indptr, mesh.indices, persistence_m, basin, persistence)
    vertices = np.flatnonzero(persistence > 0)
    vertices = vertices[np.argsort(-height[vertices], kind="stable")]
    number = np.full(len(height) + 1, -1, np.int32)  # last element: basin -1
    number[vertices] = np.arange(len(vertices))
    return GeodesicExtrema(
        vertices=vertices, persistence_m=persistence[vertices], basin=number[basin]
    )


@compiled
def _flood(
    order: I64, height: F64, indptr: I32, indices: I32, least: float, basin: I32, persistence: F64
) -> None:
    """Set the peak to which each vertex leads up, and the persistence of peaks."""
    count = len(height)
    island = np.full(count, -1, np.int64)  # a tree of vertices; its root is the highest peak
    merged = np.arange(count)  # a tree of peaks; its root is a persistent peak
    for v in order:
        best = -1
        for k in range(indptr[v], indptr[v + 1]):
            w = indices[k]
            if island[w] >= 0 and (best < 0 or height[w] > height[best]):
                best = w
        if best < 0:
            island[v], basin[v] = v, v
            continue
        top = root_of(island, best)
        island[v] = top
        basin[v] = root_of(merged, basin[best])
        for k in range(indptr[v], indptr[v + 1]):
            w = indices[k]
            if island[w] < 0:
                continue
            other = root_of(island, w)
            top = root_of(island, v)
            if other == top:
                continue
            low, high = (other, top) if height[other] <= height[top] else (top, other)
            island[low] = high
            if height[low] - height[v] >= least:
                persistence[low] = height[low] - height[v]
            else:
                merged[low] = root_of(merged, basin[v] if low == other else basin[w])
    for v in order:
        basin[v] = root_of(merged, basin[v])
        if island[v] == v:
            persistence[v] = max(height[v] - height[order[-1]], least)


@compiled
def root_of(parents: I64, label: int) -> int:
    """Return the root of a node in a tree of parents, with path halving."""
    while parents[label] != label:
        parents[label] = parents[parents[label]]
        label = parents[label]
    return label
