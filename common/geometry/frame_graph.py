"""Which frame lies where: a chain of rigid transforms between any two frames that are linked."""

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

    Beside an optical frame X_optical_frame lies X_link, at the same place and with axes x forward,
    y left, z up (REP 103), unless transforms tell where X_link is.
    """

    def __init__(self) -> None:
        self._edges: Edges = {}
        self._found: dict[Edge, Edges | None] = {}  # answers so far

    def add(self, transform: StaticTransform) -> None:
        """Take a transform; it replaces an earlier one between the same frames."""
        self.link(transform.parent, transform.child, transform.matrix)

    def link(self, parent: str, child: str, matrix: F64) -> None:
        """Take a transform, 4x4 parent_from_child; it replaces an earlier one."""
        _link(self._edges, parent, child, matrix)
        self._found.clear()

    def find(self, target: str, source: str) -> F64 | None:
        """Return target_from_source.

        Args:
            target: Frame that results are in.
            source: Frame that points come from.

        Returns:
            4x4 through the fewest transforms, None if the frames are not linked.
        """
        way = self.way(target, source)
        return None if way is None else compose(way.values())

    def way(self, target: str, source: str) -> Edges | None:
        """Return the fewest transforms whose product is target_from_source, in their order.

        Args:
            target: Frame that results are in.
            source: Frame that points come from.

        Returns:
            Empty for one and the same frame, None if the frames are not linked.
        """
        if (target, source) not in self._found:
            told = _search(self._edges, target, source)
            rest = _search(self._with_links(), target, source) if told is None else told
            self._found[target, source] = rest
        return self._found[target, source]

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
    before: dict[str, Edge] = {}  # frame to the edge that leads from it towards the source
    waiting, seen = deque([source]), {source}
    while waiting and target not in seen:
        here = waiting.popleft()
        for to, start in edges:
            if start == here and to not in seen:
                seen.add(to)
                before[to] = (to, start)
                waiting.append(to)
    if target not in seen:
        return None
    way: Edges = {}
    here = target
    while here != source:
        edge = before[here]
        way[edge] = edges[edge]
        here = edge[1]
    return way
