"""Odometry from the ticks of two wheels (docs/method.md section 7)."""

import math

from common.config import Config
from common.geometry.transforms import wrap
from people4d.messages import Odometry
from people4d.messages.base import Count, Positive


class WheelConfig(Config, frozen=True, kw_only=True):
    """A base with two driven wheels; the values are those of docs/method.md section 7."""

    radius_m: Positive = 0.035  # [m] of a wheel
    track_m: Positive = 0.108  # [m] between the wheels
    # Counts of the encoder in one turn of the wheel; 2 pi if it gives radians
    ticks_per_turn: Positive = 374.0
    # Number of different readings of an encoder that overflows, for example 65536; 0: none
    wraps_at: Count = 0
    frame_id: str = "odom"  # frame of the pose
    child_frame_id: str = "base_link"  # frame of the base


class JointConfig(WheelConfig, frozen=True, kw_only=True):
    """A base whose wheels are joints of sensor_msgs/JointState, or two topics of std_msgs."""

    # Radians, as joints of ROS have; else counts of the encoder in one turn of the wheel
    ticks_per_turn: float = math.tau
    joints: tuple[str, str] = ("wheel_left_joint", "wheel_right_joint")  # names of left and right


class WheelOdometry:
    """Sum of the steps of the wheels; the pose begins at (0, 0, 0) with the first reading."""

    def __init__(self, config: WheelConfig) -> None:
        self._config = config
        self._ticks: tuple[float, float] | None = None
        self._pose = (0.0, 0.0, 0.0)
        self._sequence = 0

    def add(self, stamp_ns: int, left: float, right: float) -> Odometry:
        """Add a reading of both encoders: ticks since any beginning, forward rising.

        Returns:
            The pose: dtheta = (right - left) / track, the distance along the mean heading.
        """
        tick_m = 2 * math.pi * self._config.radius_m / self._config.ticks_per_turn
        last_left, last_right = self._ticks or (left, right)
        left_m = self._step(left - last_left) * tick_m
        right_m = self._step(right - last_right) * tick_m
        x_m, y_m, theta_rad = self._pose
        turn_rad = (right_m - left_m) / self._config.track_m
        forward_m, middle_rad = (left_m + right_m) / 2, theta_rad + turn_rad / 2
        x_m += forward_m * math.cos(middle_rad)
        y_m += forward_m * math.sin(middle_rad)
        self._pose = x_m, y_m, wrap(theta_rad + turn_rad)
        self._ticks = left, right
        self._sequence += 1
        return Odometry(
            stamp_ns=stamp_ns,
            sequence=self._sequence - 1,
            frame_id=self._config.frame_id,
            child_frame_id=self._config.child_frame_id,
            x_m=x_m,
            y_m=y_m,
            theta_rad=self._pose[2],
        )

    def _step(self, ticks: float) -> float:
        """Return the shortest step that explains a difference of readings."""
        wraps_at = self._config.wraps_at
        return (ticks + wraps_at // 2) % wraps_at - wraps_at // 2 if wraps_at else ticks
