"""Heading of a person by yaw, feet or motion."""

import numpy as np

from people4d.messages import F64
from services.gait.surface.mesh import BodyMesh

SMOOTH_S = 0.2  # Time constant of the heading [s]
JUMP_M = 0.5  # Minimum motion of the middle in one frame that shows another body [m]
FOOT_M = 0.09  # Maximum height of feet above the floor [m]
SHIN_M = (0.13, 0.28)  # Range of the height of shins above the floor [m]
AHEAD_M = 0.06  # Forward offset from shins to the visible surface of feet [m]
HEEL_M = 0.03  # Offset of visible feet from shins towards the camera at any heading [m]
SPEED_MPS = 0.5  # Speed of walking with the weight of feet [m/s]
EVIDENCE_MIN = 0.3  # Minimum evidence of a new heading, relative to the weight of feet
VERTICES_MIN = 20  # Minimum number of vertices of feet and of shins
FIXED = np.eye(4)  # Pose of a camera at rest


class HeadingEstimator:
    """Estimates heading from the track's yaw, or else from the feet's offset and the velocity.

    Offset of the feet from the shins and velocity are smoothed in a fixed frame, since a moving
    camera would turn the heading.
    """

    def __init__(self) -> None:
        self._middle_m: F64 | None = None  # fixed frame
        self._evidence: F64 = np.zeros(3)  # fixed frame
        self._heading: F64 | None = None  # fixed frame

    def update_heading(
        self,
        mesh: BodyMesh | None,
        heights_m: F64,
        dt_s: float,
        fixed_from_optical: F64 = FIXED,
        yaw_rad: float | None = None,
    ) -> F64 | None:
        """Return the heading in the optical frame, 3, level, unit length.

        `fixed_from_optical` is the camera's pose, 4x4, and `yaw_rad` the yaw of the chest in the
        fixed frame, if it is known. Returns None before the first evidence.
        """
        rotation = fixed_from_optical[:3, :3]
        before_m, self._middle_m = self._middle_m, None
        if mesh is not None and len(mesh.points_m):
            self._middle_m = rotation @ mesh.middle_m + fixed_from_optical[:3, 3]
        if yaw_rad is not None:
            self._evidence = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
            self._heading = self._evidence
        elif mesh is not None and self._middle_m is not None:
            evidence = rotation @ _feet_ahead(mesh, heights_m)
            evidence += _velocity_mps(before_m, self._middle_m, dt_s) / SPEED_MPS
            level = rotation @ ((evidence @ rotation) * (1.0, 0.0, 1.0))
            ratio = 1 - np.exp(-dt_s / SMOOTH_S)
            self._evidence = self._evidence + ratio * (level - self._evidence)
            length = float(np.linalg.norm(self._evidence))
            if length > EVIDENCE_MIN:
                self._heading = self._evidence / length
        return None if self._heading is None else self._heading @ rotation


def _velocity_mps(before_m: F64 | None, middle_m: F64, dt_s: float) -> F64:
    if before_m is None or dt_s <= 0:
        return np.zeros(3)
    moved = middle_m - before_m
    return moved / dt_s if np.linalg.norm(moved) < JUMP_M else np.zeros(3)


def _feet_ahead(mesh: BodyMesh, heights_m: F64) -> F64:
    """Return the offset of feet from shins, 3, about 1 long; 0 if they are not visible.

    A shin without a foot in its image columns belongs to a swinging leg with a lifted foot, which
    would turn the offset to the other side.
    """
    feet = heights_m < FOOT_M
    columns = np.round(mesh.pixels_px[:, 0] / mesh.step_px).astype(np.int64)
    beside = np.isin(columns, np.unique(columns[feet])[:, None] + (-1, 0, 1))
    shins = beside & (heights_m > SHIN_M[0]) & (heights_m < SHIN_M[1])
    if min(np.count_nonzero(feet), np.count_nonzero(shins)) < VERTICES_MIN:
        return np.zeros(3)
    shin = mesh.points_m[shins].mean(axis=0)
    offset = mesh.points_m[feet].mean(axis=0) - shin + HEEL_M * shin / np.linalg.norm(shin)
    return np.asarray(offset / AHEAD_M)
