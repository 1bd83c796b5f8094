"""Which frame lies where: a chain of rigid transforms between any two frames that are linked."""

from collections import deque
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from common.geometry import LINK_FROM_OPTICAL, invert
from common.messages import F64, StaticTransform

OPTICAL, LINK = "_optical_frame", "_link"
Edges: TypeAlias = dict[tuple[str, str], F64]  # (target, source): target_from_source


class FrameGraph:
    """Transforms by the names of their frames, each usable in both directions.

    Beside an optical frame X_optical_frame lies X_link, at the same place and with axes x forward,
    y left, z up (REP 103), unless transforms tell where X_link is.
    """

    def __init__(self) -> None:
        self._edges: Edges = {}
        self._found: dict[tuple[str, str], F64 | None] = {}  # answers so far

    def add(self, transform: StaticTransform) -> None:
        """Take a transform; it replaces an earlier one between the same frames."""
        _link(self._edges, transform.parent, transform.child, transform.matrix)
        self._found.clear()

    def find(self, target: str, source: str) -> F64 | None:
        """Return target_from_source.

        Args:
            target: Frame that results are in.
            source: Frame that points come from.

        Returns:
            4x4 through the fewest transforms, None if the frames are not linked.
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


def _link(edges: Edges, parent: str, child: str, matrix: F64) -> None:
    edges[parent, child] = matrix
    edges[child, parent] = invert(matrix)


def _search(edges: Mapping[tuple[str, str], F64], target: str, source: str) -> F64 | None:
    found: dict[str, F64] = {source: np.eye(4)}  # frame to frame_from_source
    waiting = deque([source])
    while waiting and target not in found:
        here = waiting.popleft()
        for (to, start), matrix in edges.items():
            if start == here and to not in found:
                found[to] = matrix @ found[here]
                waiting.append(to)
    return found.get(target)
