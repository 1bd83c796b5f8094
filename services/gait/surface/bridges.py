"""Bridges between the pieces of a body's mesh, where a limb is occluded at its joint."""

from typing import TypeAlias

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from common.compiled import compiled
from people4d.messages import F64
from services.gait.surface.segmentation import I32, I64, Mask

MAX_BRIDGES = 12  # Maximum number of bridges of one mesh

Edges: TypeAlias = tuple[I32, I32, F64]  # indptr, indices, lengths


def bridge_pieces(grid: I32, points_m: F64, edges: Edges, cells: int, gap_m: float) -> Edges:
    """Connect each piece of a mesh to the largest one by its shortest bridge.

    A bridge is no longer than `cells` in the grid of vertices and `gap_m` in space.
    """
    indptr, indices, lengths = edges
    count = len(points_m)
    graph = csr_array((lengths, indices, indptr), shape=(count, count))
    pieces, piece = connected_components(graph, directed=False)
    if pieces < 2:
        return edges
    joined = np.zeros(pieces, np.bool_)
    joined[np.argmax(np.bincount(piece))] = True
    starts, ends, spans = [], [], []
    link = np.empty(2, np.int64)
    for _ in range(min(pieces - 1, MAX_BRIDGES)):
        span = _nearest_link(grid, points_m, piece, joined, cells, gap_m, link)
        if span >= gap_m:
            break
        joined[piece[link[0]]] = True
        starts += [link[0], link[1]]
        ends += [link[1], link[0]]
        spans += [span, span]
    if not starts:
        return edges
    at = np.concatenate([np.repeat(np.arange(count), np.diff(indptr)), starts])
    order = np.argsort(at, kind="stable")
    bounds = np.concatenate([[0], np.cumsum(np.bincount(at, minlength=count))]).astype(np.int32)
    merged = np.concatenate([indices, np.array(ends, np.int32)])[order]
    return bounds, merged, np.concatenate([lengths, spans])[order]


@compiled
def _nearest_link(
    grid: I32,
    points: F64,
    piece: I32,
    joined: Mask,
    cells: int,
    gap_m: float,
    link: I64,
) -> float:
    """Set the shortest link between a joined and another piece; return its length."""
    rows, columns = grid.shape
    best = gap_m * gap_m
    for row in range(rows):
        for column in range(columns):
            here = grid[row, column]
            if here < 0 or joined[piece[here]]:
                continue
            for r in range(max(row - cells, 0), min(row + cells + 1, rows)):
                for c in range(max(column - cells, 0), min(column + cells + 1, columns)):
                    there = grid[r, c]
                    if there < 0 or not joined[piece[there]]:
                        continue
                    square = 0.0
                    for axis in range(3):
                        square += (points[here, axis] - points[there, axis]) ** 2
                    if square < best:
                        best = square
                        link[0], link[1] = here, there
    return float(np.sqrt(best))
