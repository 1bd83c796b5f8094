"""Odometry from the encoders of two wheels (docs/method.md section 7)."""

import math

from common.config import Config
from common.geometry.transforms import wrap
from people4d.messages import Odometry
from people4d.messages.base import Count, Positive


class WheelConfig(Config, frozen=True, kw_only=True):
    """Base with two driven wheels; values from docs/method.md section 7."""

    joints: tuple[str, str] = ("wheel_left_joint", "wheel_right_joint")  # names of left and right
    radius_m: Positive = 0.035  # [m] radius of a wheel
    track_m: Positive = 0.108  # [m] distance between the wheels
    ticks_per_turn: Positive = math.tau  # encoder counts per turn of a wheel; 2 pi: radians
    wraps_at: Count = 0  # number of readings before the encoder overflows, such as 65536; 0: never
    frame_id: str = "odom"  # frame of the pose
    child_frame_id: str = "base_link"  # frame of the base


class WheelOdometry:
    """Sum of the steps of the wheels; the first reading gives the pose (0, 0, 0)."""

    def __init__(self, config: WheelConfig) -> None:
        self._config = config
        self._ticks: tuple[float, float] | None = None
        self._pose = (0.0, 0.0, 0.0)
        self._sequence = 0

    def add_reading(self, stamp_ns: int, left: float, right: float) -> Odometry:
        """Add a reading of both encoders: ticks from any origin, rising forward.

        Returns:
            The pose, by dtheta = (right - left) / track and the distance along the mean heading.
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
        """Return the shortest step for a difference of readings."""
        wraps_at = self._config.wraps_at
        return (ticks + wraps_at // 2) % wraps_at - wraps_at // 2 if wraps_at else ticks
