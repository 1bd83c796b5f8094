"""Yaw of tracks: its source, and the direction of walking as the simplest one."""

import math
from collections.abc import Sequence

from common.geometry.transforms import wrap
from people4d.messages import F64
from services.tracker.interface import Measurement

States = Sequence[F64 | None]  # state of each track; None if unknown


class VelocityYaw:
    """Yaw of tracks without a state: atan2(v_y, v_x), the direction of the velocity [PIC4SeR].

    A person slower than `speed_min_mps` has no yaw. Filters of measured yaws derive from this
    class; their states are arrays, which are replaced, never changed.
    """

    def __init__(self, speed_min_mps: float = math.inf) -> None:
        self._speed_min_mps = speed_min_mps

    def predict(self, states: States, dt_s: float) -> list[F64 | None]:  # noqa: ARG002
        """Move states ahead by dt_s seconds."""
        return list(states)

    def update(
        self,
        states: States,
        measurements: Sequence[Measurement],  # noqa: ARG002
    ) -> list[F64 | None]:
        """Update N states with one measurement each, with or without a yaw."""
        return list(states)

    def read(self, state: F64 | None, velocity_mps: F64) -> float | None:  # noqa: ARG002
        """Return the yaw (radians) of a track; None if unknown."""
        v_x, v_y = float(velocity_mps[0]), float(velocity_mps[1])
        speed_mps = math.hypot(v_x, v_y)
        slow = speed_mps == 0 or speed_mps < self._speed_min_mps
        return None if slow else wrap(math.atan2(v_y, v_x))


def measured_rad(measurement: Measurement) -> float:
    """Return the measured yaw in radians; NaN if there is none."""
    yaw_rad = measurement.yaw_rad
    return math.nan if yaw_rad is None or not math.isfinite(yaw_rad) else yaw_rad
