"""Which way a person faces, by the way they walk."""

import numpy as np

from common.messages import F64
from services.gait.depth_config import DepthLayerConfig
from services.gait.surface import Surface

SMOOTH_S = 0.3  # [s] over which the velocity is averaged
JUMP_M = 0.5  # the middle of a surface that jumps so far is of something else


class Facing:
    """Follows the middle of a person's surface.

    Args:
        config: From which speed on people face the way they move.
    """

    def __init__(self, config: DepthLayerConfig) -> None:
        self._walk_mps = config.walk_mps
        self._middle: F64 | None = None
        self._velocity: F64 = np.zeros(3)
        self._facing: F64 | None = None

    def update(self, surface: Surface | None, dt_s: float) -> F64 | None:
        """Return the way that the person faces, 3, unit length; None if they never walked yet.

        Args:
            surface: Of the person.
            dt_s: Since the last frame.
        """
        if surface is None or not len(surface.points_m):
            self._middle = None
            return self._facing
        middle = np.median(surface.points_m, axis=0)
        if self._middle is not None and dt_s > 0:
            moved = middle - self._middle
            if np.linalg.norm(moved) < JUMP_M:
                share = 1 - np.exp(-dt_s / SMOOTH_S)
                self._velocity = self._velocity + share * (moved / dt_s - self._velocity)
        self._middle = middle
        level = self._velocity * (1.0, 0.0, 1.0)
        speed = float(np.linalg.norm(level))
        if speed > self._walk_mps:
            self._facing = level / speed
        return self._facing
