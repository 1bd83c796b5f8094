"""Configuration of the colour layer."""

import math
from typing import Literal

import msgspec

Tau = tuple[float, float, float, float, float, float, float, float]
PAPER_TAU: Tau = (10.0, 10.0, 1.0, 1.0, 0.1, 0.1, 0.1, 0.1)  # section 8.1


class ColourLayerConfig(msgspec.Struct, frozen=True, kw_only=True):
    """The particle filter that follows a box by its colours (method book section 8.1)."""

    particles: int = 100  # for each person; the paper tries 20 to 160
    # 8: [x, y, x', y', w, h, w', h'], pixels and pixels a frame; 4: the box keeps its size
    state: Literal[8, 4] = 8
    order: Literal[1, 2] = 1  # of the motion model
    sampling: Literal["plain", "hierarchical"] = "plain"  # hierarchical: section 8.1 [G 3.4]
    resampling: Literal["systematic", "stratified", "residual", "multinomial"] = "systematic"
    estimate: Literal["weighted_sum", "map", "robust_mean"] = "weighted_sum"
    # [px, px a frame] of noise, in the order of the state. With PAPER_TAU the size gains speed by
    # chance, and nothing slows it down
    tau: Tau = (4.0, 3.0, 1.0, 0.5, 2.0, 4.0, 0.0, 0.0)
    # What particles are weighed by. distance: of their histogram to the first one, as in the paper;
    # but half of a person has a person's colours, and so has a shelf. ratio: how much likelier each
    # pixel is the person's than of what is about the person, by its place in the box
    weights: Literal["ratio", "distance"] = "ratio"
    ratio_sigma: float = 0.05  # of ratio: of the mean logarithm over a box; default
    # Of ratio: of the logarithm of a box's width by its height to that of the first box
    aspect_sigma: float = 0.15
    bands: int = 4  # of ratio: parts of the height, each with its own colours; default
    around: float = 1.6  # of ratio: how far about a box is looked, in its widths; default
    sigma: float = 0.1  # of distance; the paper takes 1, which is nearly flat
    hue_bins: int = 20  # section 8.1
    saturation_bins: int = 20  # section 8.1
    # Points of a box that are looked at, across and down: time does not grow with the box.
    points: tuple[int, int] = (12, 32)
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
        bins = (self.hue_bins, self.saturation_bins, self.bands)
        counts = (self.particles, *bins, *self.points)
        if min(counts) < 1 or self.particles > 100_000 or max(counts[1:]) > 256:
            raise ValueError(
                f"particles, bins, bands, points: expected 1 to 100000 or 256, got {counts}"
            )
        positive = {
            "ratio_sigma": self.ratio_sigma,
            "aspect_sigma": self.aspect_sigma,
            "sigma": self.sigma,
            "robust_window_px": self.robust_window_px,
            "box_min_px": self.box_min_px,
            "speed_min_px": self.speed_min_px,
            "along_stretch": self.along_stretch,
        }
        for name, value in positive.items():
            if not 0 < value < math.inf:
                raise ValueError(f"{name}: expected > 0, got {value}")
        rest = (*self.tau, self.growth_sideways_px2, self.growth_upright)
        if not all(0 <= value < math.inf for value in rest):
            raise ValueError(f"tau, growth_*: expected >= 0, got {rest}")
        if not 1 < self.around <= 4:
            raise ValueError(f"around: expected above 1 to 4, got {self.around}")
        if not 0 <= self.along_share <= 1:
            raise ValueError(f"along_share: expected 0 to 1, got {self.along_share}")
