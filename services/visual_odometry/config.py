"""Configuration of the visual odometry; values of this project (docs/method.md section 18)."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from people4d.messages.base import Name, NameOrEmpty, Positive

MAP = "map"  # frame of published motion without a parent frame


class VisualOdometryConfig(Config, frozen=True, kw_only=True):
    """Configuration of the visual odometry."""

    camera: NameOrEmpty = ""  # camera whose images are used; empty: the first that publishes
    child_frame_id: Name = "base_link"  # frame whose motion is published; the camera is fixed to it
    # Parent frame, if a transform from the map to it is known; else motion is published in the
    # map, whose origin is the first pose of the base
    frame_id: Name = "odom"
    planar: bool = True  # the base moves on a floor: Odometry; False: freely: MovingTransform
    # Ratio of sideways to forward acceleration of a planar base: near 0 for two driven wheels, 1.0
    # for omnidirectional wheels
    sideways: Positive = 0.05
    width_px: Annotated[int, Meta(ge=64)] = 640  # width to which wider images are reduced

    def __post_init__(self) -> None:
        """Check that the frames differ."""
        super().__post_init__()
        if self.child_frame_id in (self.frame_id, MAP):
            raise ValueError(f"child_frame_id: expected another frame, got {self.child_frame_id}")
