"""Odometry from the ticks of two wheels (method book section 7)."""

import math

import msgspec

from common.geometry.transforms import wrap
from people4d.messages import Odometry


class WheelConfig(msgspec.Struct, frozen=True, kw_only=True):
    """A base with two driven wheels; the values are the odometry paper's robot."""

    radius_m: float = 0.035  # [m] of a wheel
    track_m: float = 0.108  # [m] between the wheels
    # What the encoder counts in one turn of the wheel; 2 pi where it tells radians
    ticks_per_turn: float = 374.0
    # Number of different readings of an encoder that begins anew, for example 65536; 0: it never
    # does
    wraps_at: int = 0
    frame_id: str = "odom"  # frame of the pose
    child_frame_id: str = "base_link"  # frame of the base

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: A value is out of range.
        """
        for name in ("radius_m", "track_m", "ticks_per_turn"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected > 0, got {getattr(self, name)}")
        if self.wraps_at < 0:
            raise ValueError(f"wraps_at: expected >= 0, got {self.wraps_at}")


class WheelOdometry:
    """Adds up the steps of the wheels; the pose begins at (0, 0, 0) with the first reading."""

    def __init__(self, config: WheelConfig) -> None:
        self._config = config
        self._ticks: tuple[float, float] | None = None
        self._pose = (0.0, 0.0, 0.0)
        self._sequence = 0

    def add(self, stamp_ns: int, left: float, right: float) -> Odometry:
        """Take a reading of both encoders.

        Args:
            stamp_ns: When they were read.
            left: Ticks of the left wheel since any beginning, forward rising.
            right: Ticks of the right wheel, likewise.

        Returns:
            The pose: dtheta = (right - left) / track, the way along the middle of the turn.
        """
        left_m, right_m = self._steps_m(left, right)
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

    def _steps_m(self, left: float, right: float) -> tuple[float, float]:
        if self._ticks is None:
            return 0.0, 0.0
        tick_m = 2 * math.pi * self._config.radius_m / self._config.ticks_per_turn
        steps = self._step(left - self._ticks[0]), self._step(right - self._ticks[1])
        return steps[0] * tick_m, steps[1] * tick_m

    def _step(self, ticks: float) -> float:
        """Return the shortest step that explains a difference of readings."""
        wraps_at = self._config.wraps_at
        return (ticks + wraps_at // 2) % wraps_at - wraps_at // 2 if wraps_at else ticks
