"""Which way a person faces, by the way their feet point and the way they walk."""

import numpy as np

from people4d.messages import F64
from services.gait.surface.mesh import Surface

SMOOTH_S = 0.3  # [s] over which what is seen is averaged
JUMP_M = 0.5  # the middle of a surface that jumps so far is of something else
FOOT_M = 0.09  # [m] above the floor, below which there are feet
SHIN_M = (0.13, 0.28)  # [m] above the floor
AHEAD_M = 0.06  # [m] from the shins' middle ahead to the feet's, as both are seen
HEEL_M = 0.03  # [m] that both are seen nearer to the camera than shins, whichever way they point
SURE_MPS = 1.0  # walking so fast tells as much as feet do
LEAST = 0.3  # of what feet tell alone; less tells nothing
VERTICES = 20  # of feet and of shins, at least


class Facing:
    """Follows feet against shins, and the middle of a person's surface."""

    def __init__(self) -> None:
        self._middle: F64 | None = None
        self._ahead: F64 = np.zeros(3)
        self._facing: F64 | None = None

    def update(self, surface: Surface | None, heights_m: F64, dt_s: float) -> F64 | None:
        """Return the way that the person faces, 3, level, unit length; None if nothing told yet.

        Args:
            surface: Of the person; None: nothing is seen.
            heights_m: V, of the surface above the floor.
            dt_s: Since the last frame.
        """
        if surface is None or not len(surface.points_m):
            self._middle = None
            return self._facing
        middle = np.median(surface.points_m, axis=0)
        told = self._velocity_mps(middle, dt_s) / SURE_MPS + _feet(surface.points_m, heights_m)
        self._middle = middle
        level = told * (1.0, 0.0, 1.0)
        self._ahead = self._ahead + (1 - np.exp(-dt_s / SMOOTH_S)) * (level - self._ahead)
        length = float(np.linalg.norm(self._ahead))
        if length > LEAST:
            self._facing = self._ahead / length
        return self._facing

    def _velocity_mps(self, middle: F64, dt_s: float) -> F64:
        if self._middle is None or dt_s <= 0:
            return np.zeros(3)
        moved = middle - self._middle
        return moved / dt_s if np.linalg.norm(moved) < JUMP_M else np.zeros(3)


def _feet(points_m: F64, heights_m: F64) -> F64:
    """Return how far feet are ahead of shins, 3: about 1 long; 0 if they are not seen."""
    feet = points_m[heights_m < FOOT_M]
    shins = points_m[(heights_m > SHIN_M[0]) & (heights_m < SHIN_M[1])]
    if min(len(feet), len(shins)) < VERTICES:
        return np.zeros(3)
    shin = shins.mean(axis=0)
    away = feet.mean(axis=0) - shin + HEEL_M * shin / np.linalg.norm(shin)
    return np.asarray(away / AHEAD_M)
