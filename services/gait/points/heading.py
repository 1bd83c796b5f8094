"""Heading of a person by feet and motion, and detection of exchanged left and right by it."""

from collections.abc import Mapping

import numpy as np

from people4d.messages import F64
from services.gait.points.body import UP
from services.gait.points.keypoints import PAIRS
from services.gait.points.point_filter import PointFilter
from services.gait.surface.mesh import BodyMesh

SMOOTH_S = 0.3  # [s] time constant of the heading
JUMP_M = 0.5  # a mesh whose middle moves so far in one frame is of something else
FOOT_M = 0.09  # [m] above the floor, below which there are feet
SHIN_M = (0.13, 0.28)  # [m] above the floor
AHEAD_M = 0.06  # [m] from the shins' middle ahead to the feet's, of the visible surface
HEEL_M = 0.03  # [m] that visible feet are nearer to the camera than shins at any heading
SPEED_MPS = 1.0  # walking so fast counts as much as feet do
EVIDENCE_MIN = 0.3  # of what feet count alone; less leaves the heading as it is
VERTICES_MIN = 20  # of feet and of shins
APART_M = 0.12  # [m] across between left and right, from which on a frame counts in full


class HeadingEstimator:
    """Estimates heading by the feet's offset from the shins and the velocity of the body."""

    def __init__(self) -> None:
        self._middle: F64 | None = None
        self._evidence: F64 = np.zeros(3)
        self._heading: F64 | None = None

    def update(self, mesh: BodyMesh | None, heights_m: F64, dt_s: float) -> F64 | None:
        """Return the heading, 3, level, unit length; None before there was evidence."""
        if mesh is None or not len(mesh.points_m):
            self._middle = None
            return self._heading
        middle = mesh.middle_m
        evidence = self._velocity_mps(middle, dt_s) / SPEED_MPS + _feet_ahead(
            mesh.points_m, heights_m
        )
        self._middle = middle
        level = evidence * (1.0, 0.0, 1.0)
        self._evidence = self._evidence + (1 - np.exp(-dt_s / SMOOTH_S)) * (level - self._evidence)
        length = float(np.linalg.norm(self._evidence))
        if length > EVIDENCE_MIN:
            self._heading = self._evidence / length
        return self._heading

    def _velocity_mps(self, middle: F64, dt_s: float) -> F64:
        if self._middle is None or dt_s <= 0:
            return np.zeros(3)
        moved = middle - self._middle
        return moved / dt_s if np.linalg.norm(moved) < JUMP_M else np.zeros(3)


def _feet_ahead(points_m: F64, heights_m: F64) -> F64:
    """Return the offset of feet from shins, 3, about 1 long; 0 if they are not visible."""
    feet = points_m[heights_m < FOOT_M]
    shins = points_m[(heights_m > SHIN_M[0]) & (heights_m < SHIN_M[1])]
    if min(len(feet), len(shins)) < VERTICES_MIN:
        return np.zeros(3)
    shin = shins.mean(axis=0)
    offset = feet.mean(axis=0) - shin + HEEL_M * shin / np.linalg.norm(shin)
    return np.asarray(offset / AHEAD_M)


class LeftRightCheck:
    """Detects pairs whose left and right contradict the heading for `swap_s` seconds."""

    def __init__(self, swap_s: float) -> None:
        self._swap_s = swap_s
        self._wrong_s: dict[str, float] = {}

    def swapped(
        self, points: Mapping[str, PointFilter], heading: F64 | None, dt_s: float
    ) -> list[tuple[str, str]]:
        """Return the pairs of points that have each other's name."""
        found = []
        for left, right in PAIRS:
            pair = [points.get(left), points.get(right)]
            if heading is None or not all(p and p.state == "measured" for p in pair):
                continue
            a, b = (p.motion.position_m for p in pair if p and p.motion)
            apart = float((b - a) @ np.cross(UP, heading)) / APART_M
            wrong_s = self._wrong_s.get(left, 0.0) + dt_s * float(np.clip(apart, -1.0, 1.0))
            self._wrong_s[left] = max(wrong_s, 0.0)
            if wrong_s > self._swap_s:
                self._wrong_s[left] = 0.0
                found.append((left, right))
        return found
