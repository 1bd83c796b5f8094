"""Configuration of the pair of models for people who stand and people who walk."""

import math

import msgspec


class StandingConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Whoever stands has no velocity. All values are this project's (benchmarks/moving_base.md)."""

    enabled: bool = False  # section 5: False
    sway_mps: float = 0.03  # [m/s] standard deviation of the velocity of people who stand
    drift_m2ps: float = 0.0005  # [m^2/s] by which the variance of where they stand grows
    walk_sigma_mps: float = 0.6  # [m/s] of people who begin to walk, each way
    # [s] mean time until somebody who stands begins to walk; short, so that they are believed soon
    stands_s: float = 0.5
    walks_s: float = 10.0  # [s] and until somebody who walks stops
    # The models are weighed with R divided by this: `noise_factor` makes R larger because errors
    # last, but which model is right shows in the errors as they are
    evidence: float = 4.0

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if name != "enabled" and not 0 < value < math.inf:
                raise ValueError(f"{name}: expected a finite number > 0, got {value}")
