"""Configuration of the cascade."""

import math

import msgspec

from services.gait.colour.config import ColourLayerConfig
from services.gait.points.config import DepthLayerConfig
from services.gait.surface.body_config import BodyConfig
from services.gait.surface.floor import FloorConfig


class CascadeConfig(msgspec.Struct, frozen=True, kw_only=True):
    """From boxes and depth to the points of people (method book section 8)."""

    colour: ColourLayerConfig = ColourLayerConfig()  # carries boxes between detections
    body: BodyConfig = BodyConfig()
    floor: FloorConfig = FloorConfig()
    depth: DepthLayerConfig = DepthLayerConfig()
    seed: int = 0  # of all random numbers
    # People whose depth is looked at in one frame, which bounds the time; of more, those whose turn
    # is longest ago. The others' points are predicted
    people_max: int = 6
    box_margin: float = 0.06  # of a box's height, by which it is widened: it may miss a hand
    colour_margin: float = 0.12  # the same of a box that the colour layer carries on
    colour_distance_max: float = 0.6  # of colours, 0 to 1, beyond which they carry a box no more
    carry_s: float = 2.0  # [s] that colours carry a box without a detection
    forget_s: float = 2.0  # [s] after which a person of whom nobody tells any more is forgotten
    gap_s: float = 1.0  # [s] between frames, beyond which points start anew
    keep_details: bool = False  # estimates tell surfaces and particles, for pictures

    def __post_init__(self) -> None:
        """Check numbers.

        Raises:
            ValueError: One is out of range.
        """
        if self.people_max < 1:
            raise ValueError(f"people_max: expected >= 1, got {self.people_max}")
        margins = (self.box_margin, self.colour_margin)
        if not all(0 <= margin <= 1 for margin in margins):
            raise ValueError(f"box_margin, colour_margin: expected 0 to 1, got {margins}")
        if not 0 <= self.colour_distance_max <= 1:
            raise ValueError(
                f"colour_distance_max: expected 0 to 1, got {self.colour_distance_max}"
            )
        times = (self.carry_s, self.forget_s, self.gap_s)
        if not all(0 < time < math.inf for time in times):
            raise ValueError(f"carry_s, forget_s, gap_s: expected > 0, got {times}")
