"""Sources of the yaw of tracks."""

from services.tracker.config import TrackerConfig
from services.tracker.motion.yaw import VelocityYaw
from services.tracker.motion.yaw_density import DensityYaw
from services.tracker.motion.yaw_kalman import KalmanYaw


def make_yaw(config: TrackerConfig) -> VelocityYaw:
    """Build the configured estimator."""
    match config.yaw:
        case "keypoints":
            return DensityYaw(config.yaw_filter)
        case "kalman":
            return KalmanYaw(config.yaw_kalman)
        case "velocity":
            return VelocityYaw(config.yaw_speed_min_mps)
    return VelocityYaw()
