"""Configuration of steps."""

import math

import msgspec


class StepConfig(msgspec.Struct, frozen=True, kw_only=True):
    """What counts as a step, and how many tell of a walk. All values are this project's."""

    window_s: float = 6.0  # [s] of the past that measures are of
    every_s: float = 0.2  # [s] how often they are worked out anew
    steps_min: int = 4  # in the window, from which a person's walk is told
    speed_min_mps: float = 0.2  # [m/s] slower people stand, whatever their feet do
    separation_min_m: float = 0.12  # [m] of the feet, along the way, in a step
    step_min_s: float = 0.25  # [s] shorter ones are noise
    step_max_s: float = 1.5  # [s] longer ones are pauses
    gap_s: float = 0.35  # [s] a foot may be unseen within a step
    heading_s: float = 1.2  # [s] over which the way of walking is taken, about a stride
    smooth_s: float = 0.04  # [s] standard deviation of what smooths the feet's separation
    stance_s: float = 0.2  # [s] in the middle of a stance, in which the foot lies still

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: A number is out of range.
        """
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise ValueError(f"{name}: expected a finite number > 0, got {value}")
        if self.steps_min < 3:
            raise ValueError(f"steps_min: expected >= 3, got {self.steps_min}")
        if self.step_min_s >= self.step_max_s:
            raise ValueError(
                f"step_min_s: expected below step_max_s, got {self.step_min_s} and "
                f"{self.step_max_s}"
            )
