"""Configuration of the ground-truth bridge."""

import math
from typing import Literal

import msgspec
import numpy as np

from common.geometry.transforms import rotation_from_rpy, transform_from
from people4d.messages import StaticTransform


class FixedTransform(msgspec.Struct, frozen=True, kw_only=True):
    """Where one frame lies in another, as calibrated."""

    parent: str  # name of the frame that holds the other, for example "map"
    child: str  # name of the other, for example "mocap"
    xyz_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] origin of child in parent
    rpy_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [rad] about parent's fixed x, y, z

    def __post_init__(self) -> None:
        """Check numbers."""
        if not np.all(np.isfinite([*self.xyz_m, *self.rpy_rad])):
            raise ValueError(f"transforms: expected finite numbers, got {self}")

    def message(self) -> StaticTransform:
        """Return it as the camera would tell it.

        Raises:
            ValueError: A name cannot be that of a frame.
        """
        matrix = transform_from(self.xyz_m, rotation_from_rpy(*self.rpy_rad))
        return StaticTransform(
            stamp_ns=0, sequence=0, parent=self.parent, child=self.child, matrix=matrix
        )


class GtBridgeConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Where the truth comes from, how fast it goes out, and how tracks are judged by it."""

    # recording, ROS bag, CSV, MOT text, gt.npz or its folder, zenoh:KEY of live people_msgs/People;
    # empty: none, which is no error
    truth: str = ""
    # kind of truth: auto, recording, rosbag, npz, csv, mot, live, or module:Class of your own
    source: str = "auto"
    topic: str = ""  # ROS topic of people_msgs/People; empty: the only one in the bag
    rate_hz: float = 0.0  # [Hz] of the frames of MOT text; 0: as seqinfo.ini beside it says
    # time
    pace: Literal["frames", "recorded"] = "frames"  # with the pipeline, or by its own clock
    offset_s: float = 0.0  # [s] added to stamps of the truth: from its clock to the camera's
    loop_s: float = 0.0  # [s] what a looping camera adds to its stamps each round; 0: no loop
    # frames
    truth_frame: str = ""  # frame that the truth is in; empty: what its source says, else map
    frame_id: str = "map"  # frame that it is published in
    transforms: tuple[FixedTransform, ...] = ()  # beside those that the camera tells
    # score
    gate_m: float = 1.0  # [m] a track farther from the truth is not that person
    align_clock_s: float = 0.0  # [s] widest clock offset looked for from the tracks; 0: none
    align_space: Literal["off", "2d", "3d"] = "off"  # look for a motion: turn about z, any rotation
    apply_alignment: bool = False  # True: errors are told after the alignment that was found

    def __post_init__(self) -> None:
        """Check numbers and names."""
        if not math.isfinite(self.offset_s):
            raise ValueError(f"offset_s: expected a finite number, got {self.offset_s}")
        for name in ("loop_s", "rate_hz"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected >= 0, got {getattr(self, name)}")
        if not 0 <= self.align_clock_s <= 5:
            raise ValueError(f"align_clock_s: expected 0 to 5, got {self.align_clock_s}")
        if not 0 < self.gate_m < math.inf:
            raise ValueError(f"gate_m: expected > 0, got {self.gate_m}")
        for transform in self.transforms:
            transform.message()
