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
    join_m: float = 0.4  # [m] gap in depth to a part that is hidden at its joint; 0: never joined
    pixels_min: int = 30  # of a body and of a joined part; default
    vertices: int = 3000  # about as many, at most, has a surface; 0: one for each pixel
    edge_m: float = 0.015  # [m] between neighbouring vertices; section 8.2
    edge_stretch: float = 2.0  # times the spacing that a surface seen head-on has; default
    normal_passes: int = 1  # how often normals are averaged with their neighbours'; 0 in the paper

    def __post_init__(self) -> None:
        """Check numbers.

        Raises:
            ValueError: One is out of range.
        """
        counts = (self.fill_passes, self.normal_passes, self.pixels_min, self.vertices)
        if min(counts) < 0 or max(self.fill_passes, self.normal_passes) > 100:
            raise ValueError(f"fill_passes, normal_passes, ...: expected 0 to 100, got {counts}")
        if not 1 <= self.fill_neighbours <= 8:
            raise ValueError(f"fill_neighbours: expected 1 to 8, got {self.fill_neighbours}")
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
        }
        for name, value in lengths.items():
            if not 0 <= value < math.inf:
                raise ValueError(f"{name}: expected >= 0, got {value}")
