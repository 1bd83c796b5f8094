"""Motion of occluded points, without measurements."""

from collections.abc import Mapping

import numpy as np

from services.gait.points.keypoints import HEAD
from services.gait.points.point_filter import PointFilter

DAMPING_S = 0.05  # Time constant with which an occluded point adopts the velocity of the head [s]


def damp_occluded(points: Mapping[str, PointFilter], dt_s: float) -> None:
    """Damp the velocity of occluded points towards the velocity of the head."""
    head = points.get(HEAD)
    if head is None or head.motion is None or head.state != "measured":
        return
    ratio = 1 - float(np.exp(-dt_s / DAMPING_S))
    for point in points.values():
        if point.motion is not None and point.state != "measured":
            point.motion.damp_velocity(head.motion.state[3:], ratio)
