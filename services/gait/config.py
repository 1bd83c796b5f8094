"""Configuration of the gait service."""

import math

import msgspec

from common.geometry.transform_history import TransformBufferConfig
from services.gait.cascade_config import CascadeConfig
from services.gait.steps.config import StepConfig


class GaitConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Configuration of the gait service. Values of this record are this project's."""

    people_max: int = 32  # before one camera, the nearest first; cascade.people_max bounds the time
    # How many frames of all cameras wait for what was found in them: enough for as long as the
    # pipeline takes, 1.5 MB each with 640x480 pixels
    frames: int = 16
    settle_s: float = 0.003  # [s] that a frame waits for a newer one of its camera to be complete
    clock_jump_s: float = 1.0  # [s] a stamp this far back begins a new time; nearer, it is stale
    base: TransformBufferConfig = TransformBufferConfig()  # plausible motion of the base
    cascade: CascadeConfig = CascadeConfig()  # the particle filters; method book section 8
    steps: StepConfig = StepConfig()  # what counts as a step

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: A number is out of range.
        """
        if not 1 <= self.people_max <= 1000 or not 1 <= self.frames <= 1000:
            raise ValueError(
                f"people_max, frames: expected 1 to 1000, got {self.people_max}, {self.frames}"
            )
        if not 0 < self.clock_jump_s < math.inf or not 0 <= self.settle_s < 1:
            raise ValueError(
                "clock_jump_s, settle_s: expected a finite number > 0, and 0 to below 1, got "
                f"{self.clock_jump_s}, {self.settle_s}"
            )
