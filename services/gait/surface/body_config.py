"""Configuration of what is made of the depth in a person's box."""

import math

import msgspec


class BodyConfig(msgspec.Struct, frozen=True, kw_only=True):
    """From the depth in a box to a body and its surface (method book section 8.2).

    The paper's thresholds, 10 mm between pixels and 15 mm between vertices, are of a camera that
    measures time of flight, at 2 to 3 m. Here they are the least that is asked for; both grow with
    the distance, as the pixels' spacing does, and with the square of it, as a stereo camera's
    noise does.
    """

    fill_passes: int = 2  # of hole filling; 1 in the paper
    fill_neighbours: int = 3  # of 8, at least so many must have depth; the paper takes any
    continuity_m: float = 0.010  # [m] between neighbouring pixels of one component; section 8.2
    continuity_per_m: float = 0.006  # [m/m] what it is at least, by the distance; default
    noise_per_m2: float = 0.0025  # [m/m^2] of neighbouring readings, by the distance squared
    noise_sigmas: float = 3.0  # how much of it counts; 0 for a camera without
    seed_window_m: float = 0.25  # [m] about the track's depth, where the component is looked for
    reach_m: float = 1.0  # [m] from the seed's depth; no part of a person is farther
    # [m] gap to a part that is hidden at its joint, as the far leg is by the near one; 0, as in the
    # paper: what is not connected is no part, or no way along the surface leads to it
    join_m: float = 0.4
    join_px: int = 4  # [px] beside the body such a part is at most; default
    pixels_min: int = 30  # of a body and of a joined part; default
    vertices: int = 3000  # about as many, at most, has a surface; 0: one for each pixel
    edge_m: float = 0.015  # [m] between neighbouring vertices; section 8.2
    # [px] about a vertex within which depth is averaged: what is left of a stereo camera's noise is
    # longer than the edges and would lengthen all ways along the surface; 0 in the paper
    smooth_px: int = 6
    edge_stretch: float = 2.0  # times the spacing that a surface seen head-on has; default
    edge_noise_per_m2: float = 0.003  # [m/m^2] of neighbouring vertices, by the distance squared
    # Shares of the body's height, from its top down: no neck is above the first or below the second
    neck_rows: tuple[float, float] = (0.06, 1 / 3)  # section 8.2; the paper begins at the top
    # Lengths in heads, from the top of the head to the neck 1 (Winter 2009, neck at 0.87, shoulders
    # at 0.82, hips at 0.53 of the stature)
    shoulders_heads: float = 1.5  # from the top of the head to where the torso begins
    hips_heads: float = 3.6  # and to where the legs begin
    normal_passes: int = 1  # how often normals are averaged with their neighbours'; 0 in the paper

    def __post_init__(self) -> None:
        """Check numbers.

        Raises:
            ValueError: One is out of range.
        """
        repeats = (self.fill_passes, self.normal_passes, self.smooth_px, self.join_px)
        if min(repeats) < 0 or max(repeats) > 100:
            raise ValueError(
                f"fill_passes, normal_passes, smooth_px, join_px: expected 0 to 100, got {repeats}"
            )
        if min(self.pixels_min, self.vertices) < 0:
            raise ValueError(
                f"pixels_min, vertices: expected >= 0, got {self.pixels_min}, {self.vertices}"
            )
        if not 1 <= self.fill_neighbours <= 8:
            raise ValueError(f"fill_neighbours: expected 1 to 8, got {self.fill_neighbours}")
        above, below = self.neck_rows
        if not 0 <= above < below <= 1:
            raise ValueError(f"neck_rows: expected 0 <= first < second <= 1, got {self.neck_rows}")
        if not 1 <= self.shoulders_heads <= self.hips_heads < math.inf:
            raise ValueError(
                "shoulders_heads, hips_heads: expected 1 <= first <= second, got "
                f"{self.shoulders_heads}, {self.hips_heads}"
            )
        lengths = {
            "continuity_m": self.continuity_m,
            "continuity_per_m": self.continuity_per_m,
            "noise_per_m2": self.noise_per_m2,
            "noise_sigmas": self.noise_sigmas,
            "seed_window_m": self.seed_window_m,
            "reach_m": self.reach_m,
            "join_m": self.join_m,
            "edge_m": self.edge_m,
            "edge_stretch": self.edge_stretch,
            "edge_noise_per_m2": self.edge_noise_per_m2,
        }
        for name, value in lengths.items():
            if not 0 <= value < math.inf:
                raise ValueError(f"{name}: expected >= 0, got {value}")
