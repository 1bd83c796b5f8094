"""Configuration of the ground-truth bridge."""

import math
from typing import Literal

import msgspec


class GtBridgeConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Where the truth comes from and how fast it goes out."""

    truth: str = ""  # recording, ROS bag, gt.npz or its folder; empty: none, which is no error
    source: str = "auto"  # kind of file: auto, recording, rosbag, lab, or module:Class of your own
    topic: str = ""  # ROS topic of people_msgs/People; empty: the only one in the bag
    pace: Literal["frames", "recorded"] = "frames"  # with the pipeline, or by its own clock
    offset_s: float = 0.0  # [s] added to stamps of the truth: from its clock to the camera's
    loop_s: float = 0.0  # [s] what a looping camera adds to its stamps each round; 0: no loop

    def __post_init__(self) -> None:
        """Check numbers."""
        if not math.isfinite(self.offset_s):
            raise ValueError(f"offset_s: expected a finite number, got {self.offset_s}")
        if not 0 <= self.loop_s < math.inf:
            raise ValueError(f"loop_s: expected >= 0, got {self.loop_s}")
