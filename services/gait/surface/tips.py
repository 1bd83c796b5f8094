"""Where limbs end: vertices that are farther along the body than all about them."""

from dataclasses import dataclass

import numpy as np

from common.compiled import compiled
from people4d.messages import F64
from services.gait.surface.mesh import I32, I64, Surface


@dataclass(frozen=True, kw_only=True)
class Tips:
    """The ends of a body's limbs, farthest first; T of them."""

    vertices: I64  # T
    persistence_m: F64  # T: how far down from the tip until the limb joins one that is longer
    basin: I32  # V: which tip each vertex leads up to; -1 where no way leads to the source


def tips_of(surface: Surface, along_m: F64, persistence_m: float) -> Tips:
    """Find the ends of limbs: local maxima of the distance along the body that last.

    The surface is flooded from the farthest vertex down. Each local maximum begins an island; where
    two islands meet, the lower one was a limb if it stood out by enough, and noise if not.

    Args:
        surface: The mesh.
        along_m: V, distance along the mesh from the trunk; inf where no way leads.
        persistence_m: How far a limb must stand out.
    """
    height = np.where(np.isfinite(along_m), along_m, -np.inf)
    reached = int(np.isfinite(along_m).sum())
    order = np.argsort(-height, kind="stable")[:reached]
    basin = np.full(len(height), -1, np.int32)
    stands = np.zeros(len(height))
    _flood(order, height, surface.indptr, surface.indices, persistence_m, basin, stands)
    vertices = np.flatnonzero(stands > 0)
    vertices = vertices[np.argsort(-height[vertices], kind="stable")]
    number = np.full(len(height) + 1, -1, np.int32)  # the last one serves basin -1
    number[vertices] = np.arange(len(vertices))
    return Tips(vertices=vertices, persistence_m=stands[vertices], basin=number[basin])


@compiled
def _flood(
    order: I64, height: F64, indptr: I32, indices: I32, least: float, basin: I32, stands: F64
) -> None:
    """Set the peak that each vertex leads up to, and how far peaks stand out."""
    count = len(height)
    island = np.full(count, -1, np.int64)  # a tree of vertices; its root is the highest peak
    merged = np.arange(count)  # a tree of peaks; its root is a peak that lasts
    for v in order:
        best = -1
        for k in range(indptr[v], indptr[v + 1]):
            w = indices[k]
            if island[w] >= 0 and (best < 0 or height[w] > height[best]):
                best = w
        if best < 0:
            island[v], basin[v] = v, v
            continue
        top = _root(island, best)
        island[v] = top
        basin[v] = _root(merged, basin[best])
        for k in range(indptr[v], indptr[v + 1]):
            w = indices[k]
            if island[w] < 0:
                continue
            other = _root(island, w)
            top = _root(island, v)
            if other == top:
                continue
            low, high = (other, top) if height[other] <= height[top] else (top, other)
            island[low] = high
            if height[low] - height[v] >= least:
                stands[low] = height[low] - height[v]
            else:
                merged[low] = _root(merged, basin[v] if low == other else basin[w])
    for v in order:
        basin[v] = _root(merged, basin[v])
        if island[v] == v:
            stands[v] = max(height[v] - height[order[-1]], least)


@compiled
def _root(parents: I64, at: int) -> int:
    while parents[at] != at:
        parents[at] = parents[parents[at]]
        at = parents[at]
    return at
