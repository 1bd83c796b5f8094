"""Frames linked by rigid transforms, and the chain of transforms between two frames."""

from collections import deque
from collections.abc import Iterable, Mapping
from typing import TypeAlias

import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL, invert
from people4d.messages import F64, StaticTransform
from people4d.topics import TRANSFORMS_MAX

OPTICAL, LINK = "_optical_frame", "_link"
PATHS_MAX = 4096
Edge: TypeAlias = tuple[str, str]  # (target, source)
Edges: TypeAlias = dict[Edge, F64]  # target_from_source by edge
Neighbours: TypeAlias = dict[str, dict[str, F64]]  # target_from_source by source and target


class FrameGraph:
    """Transforms by the names of their frames, each usable in both directions.

    An optical frame X_optical_frame implies X_link, with the same origin and axes x forward,
    y left, z up (REP 103), unless X_link is linked by transforms.
    """

    def __init__(self) -> None:
        self._neighbours: Neighbours = {}
        self.changes = 0  # number of added or replaced transforms
        self._count = 0
        self._with_links: Neighbours | None = None  # cache of _linked
        self._paths: dict[Edge, Edges | None] = {}  # cache of searches

    def add_transform(self, transform: StaticTransform) -> bool:
        """Add a transform; it replaces an earlier one between the same frames.

        Returns:
            False if there are too many already.
        """
        return self.link(transform.parent, transform.child, transform.matrix)

    def link(self, parent: str, child: str, matrix: F64) -> bool:
        """Add a transform, 4x4 parent_from_child; it replaces an earlier one.

        Returns:
            False if there are too many already.
        """
        before = self._neighbours.get(child, {}).get(parent)
        if before is not None and np.array_equal(before, matrix):
            return True
        if before is None:
            if self._count >= TRANSFORMS_MAX:
                return False
            self._count += 1
        is_new = not {parent, child} & self._neighbours.keys()
        _link(self._neighbours, parent, child, matrix)
        self.changes += 1
        if is_new and not any(name.endswith((OPTICAL, LINK)) for name in (parent, child)):
            # Two frames unlinked to others change only the chain between them.
            self._paths.pop((parent, child), None)
            self._paths.pop((child, parent), None)
            if self._with_links is not None:
                _link(self._with_links, parent, child, matrix)
        else:
            self._paths.clear()
            self._with_links = None
        return True

    def lookup(self, target: str, source: str) -> F64 | None:
        """Return target_from_source through the fewest transforms, None if they are not linked."""
        path = self.path(target, source)
        return None if path is None else compose(path.values())

    def path(self, target: str, source: str) -> Edges | None:
        """Return the fewest transforms whose product is target_from_source, in their order.

        Returns:
            Empty for identical frames, None if the frames are not linked.
        """
        if (target, source) not in self._paths:
            if len(self._paths) >= PATHS_MAX:
                self._paths.clear()
            path = _search(self._neighbours, target, source)
            if path is None:
                self._with_links = self._with_links or self._linked()
                path = _search(self._with_links, target, source)
            self._paths[target, source] = path
        return self._paths[target, source]

    def _linked(self) -> Neighbours:
        """Return the transforms, including transforms between optical frames and their links."""
        neighbours = {source: dict(targets) for source, targets in self._neighbours.items()}
        for optical in sorted(name for name in self._neighbours if name.endswith(OPTICAL)):
            link = optical.removesuffix(OPTICAL) + LINK
            if _search(self._neighbours, link, optical) is None:
                _link(neighbours, link, optical, LINK_FROM_OPTICAL)
        return neighbours


def find_loop(parents: Mapping[str, str], children: Iterable[str] = ()) -> list[str]:
    """Return a loop of frames: each frame's parent is the next, and the last is the first.

    Args:
        parents: Parent of each frame by its name.
        children: First frames of the search; all frames if empty.
    """
    checked = set[str]()
    for child in children or parents:
        chain = [child]
        while (parent := parents.get(chain[-1])) is not None and parent not in checked:
            if parent in chain:
                return [*chain[chain.index(parent) :], parent]
            chain.append(parent)
        checked.update(chain)
    return []


def compose(matrices: Iterable[F64]) -> F64:
    """Return the product of transforms."""
    product = np.eye(4)
    for matrix in matrices:
        product = product @ matrix
    return product


def _link(neighbours: Neighbours, parent: str, child: str, matrix: F64) -> None:
    neighbours.setdefault(child, {})[parent] = matrix
    neighbours.setdefault(parent, {})[child] = invert(matrix)


def _search(neighbours: Neighbours, target: str, source: str) -> Edges | None:
    """Search breadth first from the source."""
    before: dict[str, str | None] = {source: None}
    queue = deque([source])
    while queue and target not in before:
        frame = queue.popleft()
        for other in neighbours.get(frame, {}):
            if other not in before:
                before[other] = frame
                queue.append(other)
    if target not in before:
        return None
    path: Edges = {}
    frame, step = target, before[target]
    while step is not None:
        path[frame, step] = neighbours[step][frame]
        frame, step = step, before[step]
    return path
