"""Frames over time: static and moving rigid transforms."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from common.geometry.frame_graph import Edge, FrameGraph, compose
from common.geometry.planar_covariance import is_plausible
from common.geometry.transform_history import (
    COUNTERS,
    HISTORY_S,
    TransformEstimate,
    TransformHistory,
)
from common.geometry.transforms import LINK_FROM_OPTICAL, invert, rotation_from_rpy, transform_from
from people4d.messages import F64, MovingTransform, Odometry, StaticTransform

MOVING_MAX = 128  # maximum number of moving transforms
KNOWN_MAX = 1024  # maximum number of known poses of cameras
SIGMA_MAX_M = 100.0  # maximum standard deviation of a known position of odometry [m]
SIGMA_MAX_RAD = 3.2  # maximum standard deviation of a known yaw of odometry [rad]


class TransformBuffer:
    """Static and moving transforms, each usable in both directions, like the buffer of tf2."""

    def __init__(self, history_s: float = HISTORY_S) -> None:
        self.counters = Counter(dict.fromkeys(COUNTERS, 0))
        self._history_s = history_s
        self._graph = FrameGraph()
        self._histories: dict[Edge, TransformHistory] = {}
        self._odometry: set[Edge] = set()  # transforms from odometry
        self._known: set[Edge] = set()  # poses of cameras

    @property
    def changes(self) -> int:
        """Number of changes of fixed transforms and of links between frames."""
        return self._graph.changes

    def add_transform(self, message: StaticTransform | MovingTransform | Odometry) -> None:
        """Add a static transform, or a sample of a moving transform."""
        if isinstance(message, StaticTransform):
            self.counters["refused_transforms"] += not self._graph.add_transform(message)
        elif isinstance(message, MovingTransform):
            self._add_sample((message.parent, message.child), message.stamp_ns, message.matrix)
        else:
            edge = message.frame_id, message.child_frame_id
            matrix = transform_from_odometry(message)
            self._add_sample(edge, message.stamp_ns, matrix, self._usable(message.covariance))
            if edge in self._histories and edge not in self._odometry:
                self._odometry.add(edge)
                self._graph.changes += 1

    def _usable(self, covariance: F64 | None) -> F64 | None:
        """Return the covariance of odometry; None, counted, if it is implausible."""
        if covariance is None or is_plausible(covariance, SIGMA_MAX_M, SIGMA_MAX_RAD):
            return covariance
        self.counters["motion_bad_covariances"] += 1
        return None

    def _add_sample(
        self, edge: Edge, stamp_ns: int, matrix: F64, covariance: F64 | None = None
    ) -> None:
        if edge not in self._histories:
            if len(self._histories) >= MOVING_MAX or not self._graph.link(*edge, np.eye(4)):
                self.counters["refused_transforms"] += 1
                return
            self._histories[edge] = TransformHistory(self.counters, self._history_s)
        self._histories[edge].add_sample(stamp_ns, matrix, covariance)

    def lookup(self, target: str, source: str, stamp_ns: int) -> TransformEstimate | None:
        """Return target_from_source at a time; None if no transform links the frames."""
        path = self._graph.path(target, source)
        if path is None:
            return None
        estimates, matrix, base = list[TransformEstimate](), np.eye(4), None
        for edge, fixed in path.items():
            estimate = self._at(edge, fixed, stamp_ns)
            if estimate is None:
                return None
            base = base or (estimate.base and estimate.base.in_frame(matrix))
            matrix = matrix @ estimate.matrix
            estimates.append(estimate)
        return TransformEstimate(
            matrix,
            math.hypot(*(one.sigma_m for one in estimates)),
            math.hypot(*(one.sigma_rad for one in estimates)),
            base,
        )

    def camera_pose(self, frame_id: str, optical_frame_id: str, stamp_ns: int) -> F64 | None:
        """Return frame_from_optical at a time; None if the known pose does not cover this time.

        If a camera has no transform, it is at the origin and points along +x.
        """
        found = self.lookup(frame_id, optical_frame_id, stamp_ns)
        if found is not None:
            if len(self._known) < KNOWN_MAX:
                self._known.add((frame_id, optical_frame_id))
            return found.matrix
        return None if (frame_id, optical_frame_id) in self._known else LINK_FROM_OPTICAL

    def lookup_static(self, target: str, source: str) -> F64 | None:
        """Return target_from_source if it is fixed; None if it moves or is unknown."""
        path = self._graph.path(target, source)
        if path is None or any(self._history(edge) for edge in path):
            return None
        return compose(path.values())

    def fixed_frame(self, frame: str) -> str:
        """Return the parent frame of the base that carries a frame; else the frame itself.

        A base is the child of odometry, or of another moving transform without moving children.
        """
        parents = {parent for parent, _ in self._histories}
        for parent, child in self._histories:
            is_base = (parent, child) in self._odometry or frame not in parents
            if is_base and self.lookup_static(frame, child) is not None:
                return parent
        return frame

    def awaits_sample(self, target: str, source: str, stamp_ns: int) -> bool:
        """Check for a moving transform between two frames that ends before a time."""
        histories = map(self._history, self._graph.path(target, source) or {})
        return any(stamp_ns > (one.newest_ns or stamp_ns) for one in histories if one)

    def _history(self, edge: Edge) -> TransformHistory | None:
        return self._histories.get(edge) or self._histories.get(edge[::-1])

    def _at(self, edge: Edge, fixed: F64, stamp_ns: int) -> TransformEstimate | None:
        if edge in self._histories:
            return self._histories[edge].at(stamp_ns)
        if edge[::-1] not in self._histories:
            return TransformEstimate(fixed)
        reverse = self._histories[edge[::-1]].at(stamp_ns)
        return replace(reverse, matrix=invert(reverse.matrix), base=None) if reverse else None


def transform_from_odometry(odometry: Odometry) -> F64:
    """Return the 4x4 pose of the base on the plane."""
    rotation = rotation_from_rpy(0.0, 0.0, odometry.theta_rad)
    return transform_from((odometry.x_m, odometry.y_m, 0.0), rotation)
