"""Configuration of the visual odometry; values are this project's (docs/method.md section 18)."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from people4d.messages.base import Name, NameOrEmpty, NonNegative, Positive, PositiveInt

Fraction = Annotated[float, Meta(gt=0, lt=1)]


class CornerConfig(Config, frozen=True, kw_only=True):
    """Points of an image that are tracked."""

    width_px: Annotated[int, Meta(ge=64)] = 640  # wider images are reduced; pixels are then of that
    cell_px: Annotated[int, Meta(ge=4)] = 12  # the best corner of each square of this side
    near_max: PositiveInt = 150  # the best of these with a depth reading ...
    far_max: PositiveInt = 100  # ... of those too far for the sensor ...
    people_max: PositiveInt = 50  # ... and of those on people, who may stand still
    contrast_min: Positive = 1.5  # [grey levels a pixel] of 255, across the weaker direction
    range_min_m: Positive = 0.3  # [m] nearer depth is invalid
    range_max_m: Annotated[float, Meta(gt=0, lt=65)] = 10.0  # [m] likewise farther
    # [1/m] standard deviation of inverse depth: 0.1 px between two imagers 5 cm apart
    sigma_inverse: Positive = 0.004
    near_min: PositiveInt = 8  # points with a depth reading; fewer give no translation
    edge_share: Positive = 0.04  # of its depth by which a corner's surroundings may differ
    people_margin: NonNegative = 0.15  # margin of a person's box, of its sides
    people_depth_m: Positive = 0.7  # [m] before and behind a person that belong to them
    people_age_s: NonNegative = 0.4  # [s] validity of detections

    def __post_init__(self) -> None:
        """Check the order of the range."""
        super().__post_init__()
        if self.range_min_m >= self.range_max_m:
            raise ValueError(f"range_min_m: expected < range_max_m, got {self.range_min_m}")


class FlowConfig(Config, frozen=True, kw_only=True):
    """Pyramidal Lucas-Kanade optical flow, forward and backward."""

    window_px: Annotated[int, Meta(ge=5)] = 17  # side of the compared windows
    levels: PositiveInt = 3  # halvings of the image
    steps: PositiveInt = 15  # at most, on each level
    back_max_px: Positive = 1.0  # largest distance to the start after forward and backward flow


class FitConfig(Config, frozen=True, kw_only=True):
    """Acceptance of a motion."""

    rounds: PositiveInt = 32  # random samples
    sigma_px: Positive = 0.7  # standard deviation of the position of a point
    people_sigma_px: Positive = 3.0  # likewise on a person, who hardly ever stands quite still
    gate_sigmas: Positive = 3.0  # gate of a point of the room
    prior_sigmas: Positive = 5.0  # gate of a motion around the predicted one
    room_min: Annotated[int, Meta(ge=3)] = 4  # points of the room that have to agree
    points_min: Annotated[int, Meta(ge=6)] = 12  # points of all that have to agree ...
    share_min: Annotated[float, Meta(gt=0, le=1)] = 0.4  # ... and of those tracked
    # Errors of points close together are correlated, so that there is less to average over
    sigma_factor: Positive = 2.5  # on the standard deviation of the motion
    sigma_max_m: Positive = 0.1  # [m] a less certain motion since the keyframe is refused
    sigma_max_rad: Positive = 0.03  # [rad] likewise


class VisualOdometryConfig(Config, frozen=True, kw_only=True):
    """Configuration of the visual odometry."""

    camera: NameOrEmpty = ""  # camera whose images are taken; empty: the first that publishes one
    child_frame_id: Name = "base_link"  # frame whose motion is published; the camera is fixed to it
    # Parent frame, if a transform from `map_id` to it is known; else motion is published in the
    # map, which begins at the first pose of the base
    frame_id: Name = "odom"
    map_id: Name = "map"
    planar: bool = True  # the base moves on a floor: Odometry; False: freely: MovingTransform
    corners: CornerConfig = CornerConfig()
    flow: FlowConfig = FlowConfig()
    fit: FitConfig = FitConfig()
    # Motion is relative to one of some keyframes, so that it does not drift while the base stands
    keyframes: PositiveInt = 12  # number of these
    overlap_min: Fraction = 0.5  # share of a keyframe's points that have to be found again
    # Largest drift of a keyframe used again that is corrected
    jump_max_m: Positive = 0.005  # [m]
    jump_max_rad: Positive = 0.002  # [rad]
    # Times
    predict_s: Positive = 0.5  # [s] the last motion is extrapolated
    lost_s: Positive = 0.4  # [s] without motion, after which a new keyframe begins there
    clock_jump_s: Positive = 1.0  # [s] a stamp this far back begins a new time; nearer: stale
    # Faster motion is implausible
    speed_max_mps: Positive = 4.0  # [m/s]
    turn_max_radps: Positive = 6.0  # [rad/s]
    # Sideways over forward acceleration of a planar base: two driven wheels hardly permit any; 1.0
    # for wheels that roll any way
    sideways: Positive = 0.05
    # Standard deviations of the motion of a base: at first, and then
    speed_sigma_mps: Positive = 0.5  # [m/s]
    turn_sigma_radps: Positive = 1.0  # [rad/s]
    sigma_acceleration_mps2: Positive = 1.0  # [m/s^2]
    sigma_turn_radps2: Positive = 2.0  # [rad/s^2]

    def __post_init__(self) -> None:
        """Check that the frames differ."""
        super().__post_init__()
        if self.child_frame_id in (self.frame_id, self.map_id):
            raise ValueError(f"child_frame_id: expected another frame, got {self.child_frame_id}")
