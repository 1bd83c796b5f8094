"""Configuration of the predictor; values are this project's (docs/method.md section 25)."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from people4d.messages.base import Name, NonNegative, Positive, PositiveInt, Probability, Ratio
from people4d.messages.prediction import HORIZONS_MAX


class PedestrianConfig(Config, frozen=True, kw_only=True):
    """Interacting models: standing, straight, turning."""

    sample_s: Positive = 0.4  # [s] between two positions that count as independent
    # Standard deviation of a measured position, per axis: of the first ones, least, and per
    # measured noise
    sigma_m: Positive = 0.05  # [m]
    sigma_min_m: Positive = 0.005  # [m]
    noise_factor: Positive = 1.7
    # Position and velocity of a track count with these shares of their standard deviations: a
    # tracker's velocity is more accurate than its covariance
    track_factors: tuple[Positive, Positive] = (0.9, 0.3)
    sigma_min_mps: Positive = 0.02  # [m/s]
    sigma_first_mps: Positive = 1.5  # [m/s] of the velocity of a person just found, per axis
    first: tuple[Probability, Probability, Probability] = (0.05, 0.6, 0.35)  # modes at first
    sway_mps: Positive = 0.026  # [m/s] velocity of a standing person
    sway_mps2: Positive = 0.083
    straight_mps2: Positive = 0.2
    turning_mps2: Positive = 0.5
    standing_decay_s: Positive = 1.3
    straight_decay_s: Positive = 1000.0
    turning_decay_s: Positive = 1000.0
    change_rates_hz: tuple[
        tuple[NonNegative, NonNegative, NonNegative],
        tuple[NonNegative, NonNegative, NonNegative],
        tuple[NonNegative, NonNegative, NonNegative],
    ] = (
        (0.0, 0.03, 0.03),
        (0.001, 0.0, 0.035),
        (0.01, 1.2, 0.0),
    )


class MemoryConfig(Config, frozen=True, kw_only=True):
    """Memory of past forecasts."""

    size: Annotated[int, Meta(ge=1, le=20000)] = 1500  # number of forecasts
    store_s: Positive = 0.8  # [s] between two forecasts of a person that are remembered
    # Standard deviations of position and velocity within which forecasts count as alike
    near_m: Positive = 1.0  # [m]
    alike_mps: Positive = 0.2  # [m/s]
    prior_weight: Positive = 5.0  # forecasts without a habit that a habit has to outweigh
    # [m/s] prior weight of the measured motion, which counts up to `from_s`
    measured_weight: Positive = 4.0
    gain_weight: Positive = 5.0  # people at 1 m/s that go on straight for certain
    from_s: Positive = 1.0  # [s] horizon from which habits count
    own_after_s: Positive = 10.0  # [s] age of forecasts of the same person that count
    scale: tuple[Positive, Positive] = (1.3, 1.0)  # of standard deviations at first: walk, stand
    # change of its logarithm by an error outside the ellipse, first and later
    scale_gain_first: Positive = 0.5
    scale_gain: Positive = 0.03


class GroupConfig(Config, frozen=True, kw_only=True):
    """Groups of people."""

    walking_mps: Positive = 0.3  # [m/s] slower people stand
    walking_m: Positive = 1.5  # [m] largest distance of two who walk together
    walking_differ_mps: Positive = 0.35  # [m/s] largest difference of their velocities
    space_m: Positive = 0.7  # [m] from a person who stands to the centre of the space before them
    space_apart_m: Positive = 0.8  # [m] largest distance of the centres of two who share it
    standing_m: Positive = 2.5  # [m] largest distance of such two
    standing_unknown_m: Positive = 0.8  # [m] likewise where a yaw is unknown
    lasts_s: Positive = 1.5  # [s] time constant of the score of a pair
    join_score: Probability = 0.6
    leave_score: Probability = 0.3


class ForecastConfig(Config, frozen=True, kw_only=True):
    """Forecast of motion."""

    motion: PedestrianConfig = PedestrianConfig()
    memory: MemoryConfig = MemoryConfig()
    groups: GroupConfig = GroupConfig()
    # Share of their group's displacement in that of its members, and the horizon [s] from which it
    # holds: each step of a person is their own
    cohesion: Ratio = 0.6
    cohesion_from_s: Positive = 1.0
    standing_mps2: Positive = 0.1
    straight_mps2: Positive = 0.2
    turning_mps2: Positive = 0.6


class PredictorConfig(Config, frozen=True, kw_only=True):
    """Configuration of the predictor."""

    # [Hz] at most so many predictions a second of the stamps; tracks between are not used
    rate_max_hz: Annotated[float, Meta(ge=2.5, le=1000)] = 10.0
    step_s: Annotated[float, Meta(ge=0.1, le=5)] = 0.5  # [s] between two horizons
    steps: Annotated[int, Meta(ge=1, le=HORIZONS_MAX)] = 10  # number of horizons
    people_max: PositiveInt = 500  # further people are not predicted
    base_frame: Name = "base_link"  # the robot's base
    robot_age_s: NonNegative = 0.5  # [s] oldest odometry that the robot's path is predicted from
    # People farther from the origin or faster are not predicted
    distance_max_m: Positive = 1e5  # [m]
    speed_max_mps: Positive = 12.0  # [m/s] of the fastest sprinters
    clock_jump_s: Positive = 1.0  # [s] a stamp older than the newest by more: the clock was reset
    forecast: ForecastConfig = ForecastConfig()
