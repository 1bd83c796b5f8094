"""Which frame lies where at a time: rigid transforms, some of which change."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from common.geometry.frame_graph import Edge, FrameGraph, compose
from common.geometry.transform_history import (
    COUNTERS,
    Placement,
    TransformBufferConfig,
    TransformHistory,
)
from common.geometry.transforms import invert, rotation_from_rpy, transform_from
from people4d.messages import F64, MovingTransform, Odometry, StaticTransform


class TransformBuffer:
    """Fixed transforms and trails, each usable in both directions.

    Args:
        config: What motions are believed.
    """

    def __init__(self, config: TransformBufferConfig) -> None:
        self.counters = Counter(dict.fromkeys(COUNTERS, 0))
        self._config = config
        self._graph = FrameGraph()
        self._trails: dict[Edge, TransformHistory] = {}
        self._bases: set[Edge] = set()  # of these, the ones that odometry tells

    def add(self, message: StaticTransform | MovingTransform | Odometry) -> None:
        """Take a transform that holds for ever, or one at its stamp."""
        if isinstance(message, StaticTransform):
            self._graph.add(message)
        elif isinstance(message, MovingTransform):
            self._follow((message.parent, message.child), message.stamp_ns, message.matrix)
        else:
            edge = message.frame_id, message.child_frame_id
            self._bases.add(edge)
            self._follow(edge, message.stamp_ns, matrix_of(message))

    def _follow(self, edge: Edge, stamp_ns: int, matrix: F64) -> None:
        if edge not in self._trails:
            self._trails[edge] = TransformHistory(self._config, self.counters)
            self._graph.link(*edge, np.eye(4))
        self._trails[edge].add(stamp_ns, matrix)

    def find(self, target: str, source: str, stamp_ns: int) -> Placement | None:
        """Return target_from_source at a time; None if the frames are not linked then."""
        way = self._graph.way(target, source)
        if way is None:
            return None
        placed = [self._at(edge, matrix, stamp_ns) for edge, matrix in way.items()]
        known = [one for one in placed if one is not None]
        if len(known) < len(placed):
            return None
        return Placement(
            compose(one.matrix for one in known),
            math.hypot(*(one.sigma_m for one in known)),
            math.hypot(*(one.sigma_rad for one in known)),
        )

    def standing(self, target: str, source: str) -> F64 | None:
        """Return target_from_source if that never changes; None if it does, or is not known."""
        way = self._graph.way(target, source)
        if way is None or any(self._trail(edge) for edge in way):
            return None
        return compose(way.values())

    def ground(self, frame: str) -> str:
        """Return the frame that a frame on a moving base moves in; itself if it is on none.

        A base is the child of odometry, or of another moving transform if nothing moves in it.
        """
        parents = {parent for parent, _ in self._trails}
        for parent, child in self._trails:
            is_base = (parent, child) in self._bases or frame not in parents
            if is_base and self.standing(frame, child) is not None:
                return parent
        return frame

    def waits(self, target: str, source: str, stamp_ns: int) -> bool:
        """Tell whether a sample may yet come that tells a transform at a time."""
        way = self._graph.way(target, source) or {}
        trails = (self._trail(edge) for edge in way)
        return any(stamp_ns > (trail.newest_ns or stamp_ns) for trail in trails if trail)

    def _trail(self, edge: Edge) -> TransformHistory | None:
        return self._trails.get(edge) or self._trails.get(edge[::-1])

    def _at(self, edge: Edge, fixed: F64, stamp_ns: int) -> Placement | None:
        if edge in self._trails:
            return self._trails[edge].at(stamp_ns)
        if edge[::-1] not in self._trails:
            return Placement(fixed)
        told = self._trails[edge[::-1]].at(stamp_ns)
        return replace(told, matrix=invert(told.matrix)) if told else None


def matrix_of(odometry: Odometry) -> F64:
    """Return the 4x4 pose of the base on the plane."""
    turned = rotation_from_rpy(0.0, 0.0, odometry.theta_rad)
    return transform_from((odometry.x_m, odometry.y_m, 0.0), turned)
