"""Motion of occluded points, which nothing measures."""

from collections.abc import Mapping

import numpy as np

from services.gait.points.keypoints import HEAD
from services.gait.points.point_filter import PointFilter

DAMPING_S = 0.05  # [s] time constant with which an occluded point takes the head's velocity


def damp_occluded(points: Mapping[str, PointFilter], dt_s: float) -> None:
    """Let occluded points take the head's velocity: arms do not fly off."""
    head = points.get(HEAD)
    if head is None or head.motion is None or head.state != "measured":
        return
    ratio = 1 - float(np.exp(-dt_s / DAMPING_S))
    for point in points.values():
        if point.motion is not None and point.state != "measured":
            point.motion.damp_velocity(head.motion.state[3:], ratio)
