"""Configuration of the colour layer."""

import math
from typing import Literal

import msgspec


class ColourLayerConfig(msgspec.Struct, frozen=True, kw_only=True):
    """The particle filter that follows a box by its colours (method book section 8.1)."""

    particles: int = 100  # for each person; the paper tries 20 to 160
    # 8: [x, y, x', y', w, h, w', h'], pixels and pixels a frame; 4: the box keeps its size
    state: Literal[8, 4] = 8
    order: Literal[1, 2] = 1  # of the motion model
    sampling: Literal["plain", "hierarchical"] = "plain"  # hierarchical: section 8.1 [G 3.4]
    resampling: Literal["systematic", "stratified", "residual", "multinomial"] = "systematic"
    estimate: Literal["weighted_sum", "map", "robust_mean"] = "weighted_sum"
    # [px, px a frame] of noise, in the order of the state; section 8.1
    tau: tuple[float, float, float, float, float, float, float, float] = (
        *(10.0, 10.0, 1.0, 1.0),
        *(0.1, 0.1, 0.1, 0.1),
    )
    sigma: float = 0.1  # of the distance of histograms; the paper takes 1, which is nearly flat
    hue_bins: int = 20  # section 8.1
    saturation_bins: int = 20  # section 8.1
    # Points of a box that are looked at, across and down: time does not grow with the box.
    points: tuple[int, int] = (12, 32)
    # How much it speaks against a box that what surrounds it looks like the person. 0: not at all,
    # as in the paper; but then a box within the person's is as good as the whole, and boxes shrink
    surround: float = 1.0
    robust_window_px: float = 20.0  # [px] about the MAP estimate; default
    box_min_px: float = 4.0  # [px] of a side; default
    # Hierarchical sampling: a and b have mean and variance 1, times these; the paper has 1 for
    # both, with which a box doubles within a second. Default
    growth_sideways_px2: float = 0.02  # [px^2 a frame^3] of a / |x'|
    growth_upright: float = 0.005  # [1 a frame] of b y'
    speed_min_px: float = 1.0  # [px a frame] below it there is no direction, and |x'| counts as it
    along_share: float = 0.5  # of particles that are placed along the motion; default
    along_stretch: float = 1.4  # of their noise along it, and its inverse across; default

    def __post_init__(self) -> None:
        """Check numbers.

        Raises:
            ValueError: One is out of range.
        """
        counts = (self.particles, self.hue_bins, self.saturation_bins, *self.points)
        if min(counts) < 1 or self.particles > 100_000 or max(counts[1:]) > 256:
            raise ValueError(f"particles, bins, points: expected 1 to 100000 or 256, got {counts}")
        positive = {
            "sigma": self.sigma,
            "robust_window_px": self.robust_window_px,
            "box_min_px": self.box_min_px,
            "speed_min_px": self.speed_min_px,
            "along_stretch": self.along_stretch,
        }
        for name, value in positive.items():
            if not 0 < value < math.inf:
                raise ValueError(f"{name}: expected > 0, got {value}")
        rest = (*self.tau, self.surround, self.growth_sideways_px2, self.growth_upright)
        if not all(0 <= value < math.inf for value in rest):
            raise ValueError(f"tau, surround, growth_*: expected >= 0, got {rest}")
        if not 0 <= self.along_share <= 1:
            raise ValueError(f"along_share: expected 0 to 1, got {self.along_share}")
