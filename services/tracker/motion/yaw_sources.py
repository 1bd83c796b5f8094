"""Sources of the yaw of tracks."""

from typing import Literal

from services.tracker.motion.yaw import VelocityYaw
from services.tracker.motion.yaw_density import DensityYaw
from services.tracker.motion.yaw_kalman import KalmanYaw

YawSource = Literal["keypoints", "kalman", "velocity", "none"]


def make_yaw(source: YawSource, speed_min_mps: float) -> VelocityYaw:
    """Return the filter of a source, with a minimum speed for yaws from velocity."""
    match source:
        case "keypoints":
            return DensityYaw()
        case "kalman":
            return KalmanYaw()
        case "velocity":
            return VelocityYaw(speed_min_mps)
    return VelocityYaw()
