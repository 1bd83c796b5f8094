"""Distances along the surface of a body."""

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from people4d.messages import F64
from services.gait.surface.mesh import Surface


def geodesic_m(surface: Surface, source_vertex: npt.ArrayLike, limit_m: float = np.inf) -> F64:
    """Return the lengths of the shortest ways from a vertex to all others along the mesh.

    Args:
        surface: The mesh.
        source_vertex: The vertex; of several the nearest counts.
        limit_m: Vertices farther away are not looked for.

    Returns:
        V, metres; inf where no way leads or it is longer than the limit.

    Source: method book section 8.3 [G 4.3].
    """
    count = len(surface.points_m)
    sources = np.atleast_1d(np.asarray(source_vertex, np.int64))
    sources = sources[(sources >= 0) & (sources < count)]
    if not len(sources):
        return np.full(count, np.inf)
    graph = csr_array((surface.lengths_m, surface.indices, surface.indptr), shape=(count, count))
    found = dijkstra(graph, directed=True, indices=sources, limit=limit_m, min_only=True)
    return np.asarray(found, np.float64)
