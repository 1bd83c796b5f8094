"""Frames linked by rigid transforms, and the chain of transforms between any two of them."""

from collections import deque
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL, invert
from people4d.messages import F64, StaticTransform

OPTICAL, LINK = "_optical_frame", "_link"
Edge: TypeAlias = tuple[str, str]  # (target, source)
Edges: TypeAlias = dict[Edge, F64]  # each with its target_from_source


class FrameGraph:
    """Transforms by the names of their frames, each usable in both directions.

    An optical frame X_optical_frame implies X_link, with the same origin and axes x forward,
    y left, z up (REP 103), unless X_link is linked by transforms.
    """

    def __init__(self) -> None:
        self._edges: Edges = {}
        self._paths: dict[Edge, Edges | None] = {}  # cache of searches

    def add(self, transform: StaticTransform) -> None:
        """Add a transform; it replaces an earlier one between the same frames."""
        self.link(transform.parent, transform.child, transform.matrix)

    def link(self, parent: str, child: str, matrix: F64) -> None:
        """Add a transform, 4x4 parent_from_child; it replaces an earlier one."""
        _link(self._edges, parent, child, matrix)
        self._paths.clear()

    def lookup(self, target: str, source: str) -> F64 | None:
        """Return target_from_source through the fewest transforms, None if they are not linked."""
        path = self.path(target, source)
        return None if path is None else compose(path.values())

    def path(self, target: str, source: str) -> Edges | None:
        """Return the fewest transforms whose product is target_from_source, in their order.

        Returns:
            Empty for one and the same frame, None if the frames are not linked.
        """
        if (target, source) not in self._paths:
            path = _search(self._edges, target, source)
            if path is None:
                path = _search(self._with_links(), target, source)
            self._paths[target, source] = path
        return self._paths[target, source]

    def _with_links(self) -> Edges:
        edges = dict(self._edges)
        for optical in sorted({name for name, _ in edges if name.endswith(OPTICAL)}):
            link = optical.removesuffix(OPTICAL) + LINK
            if _search(self._edges, link, optical) is None:
                _link(edges, link, optical, LINK_FROM_OPTICAL)
        return edges


def compose(matrices: Iterable[F64]) -> F64:
    """Return the product of transforms."""
    product = np.eye(4)
    for matrix in matrices:
        product = product @ matrix
    return product


def _link(edges: Edges, parent: str, child: str, matrix: F64) -> None:
    edges[parent, child] = matrix
    edges[child, parent] = invert(matrix)


def _search(edges: Edges, target: str, source: str) -> Edges | None:
    """Search breadth first from the source."""
    towards_source: dict[str, Edge | None] = {source: None}
    queue = deque([source])
    while queue and target not in towards_source:
        frame = queue.popleft()
        for edge in edges:
            if edge[1] == frame and edge[0] not in towards_source:
                towards_source[edge[0]] = edge
                queue.append(edge[0])
    if target not in towards_source:
        return None
    path: Edges = {}
    step = towards_source[target]
    while step:
        path[step] = edges[step]
        step = towards_source[step[1]]
    return path
