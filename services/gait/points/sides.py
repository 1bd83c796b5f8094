"""Which of two hands or feet is the left one, where no keypoints tell."""

from collections.abc import Mapping

import numpy as np

from people4d.messages import F64
from services.gait.points.limbs import UP
from services.gait.points.point_filter import PointFilter
from services.gait.points.points import PAIRS

APART_M = 0.12  # [m] across between left and right, from which on a frame counts in full


class Sides:
    """Notices left and right that contradict the way a person faces for long.

    Args:
        swap_s: For how long.
    """

    def __init__(self, swap_s: float) -> None:
        self._swap_s = swap_s
        self._wrong_s: dict[str, float] = {}

    def wrong(
        self, points: Mapping[str, PointFilter], facing: F64 | None, dt_s: float
    ) -> list[tuple[str, str]]:
        """Return the pairs of points that have each other's name.

        Args:
            points: By their names.
            facing: 3, the way the person faces; None: not known.
            dt_s: Since the last frame.
        """
        found = []
        for left, right in PAIRS:
            pair = [points.get(left), points.get(right)]
            if facing is None or not all(p and p.state == "measured" for p in pair):
                continue
            a, b = (p.motion.position_m for p in pair if p and p.motion)
            apart = float((b - a) @ np.cross(UP, facing)) / APART_M
            wrong_s = self._wrong_s.get(left, 0.0) + dt_s * float(np.clip(apart, -1.0, 1.0))
            self._wrong_s[left] = max(wrong_s, 0.0)
            if wrong_s > self._swap_s:
                self._wrong_s[left] = 0.0
                found.append((left, right))
        return found
