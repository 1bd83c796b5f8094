"""Configuration of steps."""

import math

import msgspec


class StepConfig(msgspec.Struct, frozen=True, kw_only=True):
    """What counts as a step, and how many tell of a walk. All values are this project's."""

    window_s: float = 8.0  # [s] of the past that measures are of
    every_s: float = 0.2  # [s] how often they are worked out anew
    strides_min: int = 3  # in the window, from which on a person's walk is told
    speed_min_mps: float = 0.2  # [m/s] slower people stand, whatever their feet do
    length_min_m: float = 0.12  # [m] of a step
    step_min_s: float = 0.25  # [s] shorter ones are noise
    step_max_s: float = 1.5  # [s] longer ones are pauses
    # [m] standard deviation of where a foot is seen that stands: more of it than noise is that the
    # toes are seen first and then the heel
    noise_m: float = 0.07
    still_s: float = 0.25  # [s] before and after a sample, in which a foot is still or not
    stance_min_s: float = 0.25  # [s] that a foot stands at least
    gap_s: float = 0.3  # [s] a foot that stands may be unseen
    length_spread: float = 0.12  # of the usual stride, by which others differ in an even walk
    time_spread: float = 0.1  # the same of its time

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: A number is out of range.
        """
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise ValueError(f"{name}: expected a finite number > 0, got {value}")
        if self.strides_min < 2:
            raise ValueError(f"strides_min: expected >= 2, got {self.strides_min}")
        if self.step_min_s >= self.step_max_s:
            raise ValueError(
                f"step_min_s: expected below step_max_s, got {self.step_min_s} and "
                f"{self.step_max_s}"
            )
