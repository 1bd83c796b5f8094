"""Configuration of the depth layer."""

import math
from typing import Literal

import msgspec

from services.gait.surface.spin_image import SpinConfig


class DepthLayerConfig(msgspec.Struct, frozen=True, kw_only=True):
    """The particle filters that follow points on a body (method book section 8.3)."""

    # What particles are weighed by. spin, geodesic: as in the paper, alone. combined: both, and
    # ends of limbs, motion and keypoints besides, each trusted by its own confidence
    feature: Literal["combined", "spin", "geodesic"] = "combined"
    # Points that are followed: those of `points.POINTS`; marked ones come on top
    points: tuple[str, ...] = ("head", "left_hand", "right_hand", "left_foot", "right_foot")
    particles: int = 60  # of each point; section 8.3, 100 in its comparison
    # [px, px a frame] noise of x, y, x', y'; section 8.1. combined: as of a person 3 m away who is
    # seen with a focal length of 615 px
    tau: tuple[float, float, float, float] = (10.0, 10.0, 1.0, 1.0)
    # Where distances along the body begin with geodesic alone; section 8.3. combined: the trunk
    source: Literal["head", "body"] = "head"
    geodesic_sigma_m: float = 0.08  # [m] of a distance along the body to that at the start; default
    spin: SpinConfig = SpinConfig()
    spin_sigma: float = 1.5  # of the similarity of spin images; default
    keypoints: bool = True  # combined: start, measure and correct by those of the detector

    # What follows is of combined only.
    keypoint_sigma_m: float = 0.04  # [m] of a keypoint, across the line of sight; default
    keypoint_confidence_min: float = 0.4  # keypoints of less are not used
    hand_reach: float = 0.5  # of the forearm, from the wrist to the middle of the hand
    foot_reach: float = 0.12  # of the shank, from the ankle to the middle of the foot
    foot_ahead_m: float = 0.07  # [m] from the ankle ahead to the middle of the foot
    tip_m: float = 0.06  # [m] that the end of a limb must stand out along the body; default
    hand_m: float = 0.09  # [m] along the body from the fingertips to the middle of the hand
    foot_m: float = 0.10  # [m] from the toes to the middle of the foot
    head_m: float = 0.17  # [m] from the top of the head, round it, to its middle
    tip_sigma_m: float = 0.04  # [m] of these three
    window_m: float = 0.06  # [m] about the best particle, over which an estimate is averaged
    acceleration_mps2: float = 12.0  # [m/s^2] of hands and feet, standard deviation; default
    noise_m: float = 0.015  # [m] of an estimate, sideways; default
    noise_per_m2: float = 0.004  # [m/m^2] of an estimate in depth, by the distance squared
    confidence_min: float = 0.25  # below it nothing is measured; default
    patience_s: float = 0.4  # [s] without a measurement until a point is lost; default
    spread_max_m: float = 0.35  # [m] standard deviation of a prediction beyond which it is lost
    swap_s: float = 0.15  # [s] that left and right must be on the wrong side, to be exchanged
    gate: float = 5.0  # [standard deviations] from its prediction that a point is believed to be
    proposed: float = 0.4  # share of particles that are placed by keypoints and ends of limbs
    adapt: float = 0.03  # of the reference distance, that each measured frame adds
    adapt_max_m: float = 0.10  # [m] that it may change in all

    def __post_init__(self) -> None:
        """Check numbers.

        Raises:
            ValueError: One is out of range.
        """
        if not 2 <= self.particles <= 10_000:
            raise ValueError(f"particles: expected 2 to 10000, got {self.particles}")
        if not all(0 <= value < math.inf for value in self.tau):
            raise ValueError(f"tau: expected >= 0, got {self.tau}")
        if len(set(self.points)) < len(self.points) or not all(self.points):
            raise ValueError(f"points: expected different names, got {self.points}")
        shares = (self.keypoint_confidence_min, self.confidence_min)
        if not all(0 <= share < 1 for share in shares):
            raise ValueError(f"*confidence_min: expected 0 to below 1, got {shares}")
        for name in self.__struct_fields__:
            value = getattr(self, name)
            number = isinstance(value, float) and name not in ("hand_reach", "foot_reach")
            if number and "confidence" not in name and not 0 < value < math.inf:
                raise ValueError(f"{name}: expected > 0, got {value}")
        if not all(0 <= reach <= 2 for reach in (self.hand_reach, self.foot_reach)):
            raise ValueError(f"*_reach: expected 0 to 2, got {self.hand_reach}, {self.foot_reach}")
