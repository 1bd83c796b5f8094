"""Configuration of the visual odometry."""

import math

import msgspec

from people4d.messages.base import check_name


def _expect_positive(record: msgspec.Struct, *names: str) -> None:
    for name in names:
        value = getattr(record, name)
        _expect(0 < value < math.inf, f"{name}: expected a finite number > 0", value)


def _expect(holds: bool, what: str, got: object) -> None:
    if not holds:
        raise ValueError(f"{what}, got {got}")


class CornerConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Which points of a picture are followed. Values are this project's."""

    width_px: int = 640  # wider pictures are reduced to it; pixels below are of the reduced one
    cell_px: int = 12  # the best corner of each square of this side is taken
    near_max: int = 150  # the best of these whose depth is known ...
    far_max: int = 100  # ... of those that are too far for the sensor ...
    people_max: int = 50  # ... and of those on people, who may stand still
    contrast_min: float = 1.5  # [grey levels a pixel] of 255, across the corner's weaker direction
    range_min_m: float = 0.3  # [m] nearer depth is not believed
    range_max_m: float = 10.0  # [m] likewise farther; it may exceed what people are seen at
    # [1/m] standard deviation of inverse depth: 0.1 px between two imagers 5 cm apart
    sigma_inverse: float = 0.004
    near_min: int = 8  # points whose depth is known; fewer tell no way
    edge_share: float = 0.04  # of its depth by which a corner's surroundings may differ
    people_margin: float = 0.15  # of a person's box that is theirs, too, around it
    people_depth_m: float = 0.7  # [m] before and behind a person that belong to them
    people_age_s: float = 0.4  # [s] people found so long ago are still there

    def __post_init__(self) -> None:
        """Check ranges."""
        _expect_positive(
            self, "cell_px", "near_max", "far_max", "people_max", "contrast_min", "edge_share"
        )
        _expect_positive(self, "people_depth_m", "sigma_inverse", "near_min")
        _expect(self.width_px >= 64, "width_px: expected >= 64", self.width_px)
        _expect(self.cell_px >= 4, "cell_px: expected >= 4", self.cell_px)
        for name in ("people_margin", "people_age_s"):
            value = getattr(self, name)
            _expect(0 <= value < math.inf, f"{name}: expected a finite number >= 0", value)
        near_m, far_m = self.range_min_m, self.range_max_m
        _expect(0 < near_m < far_m < 65, "range: expected 0 < min < max < 65 m", (near_m, far_m))


class FlowConfig(msgspec.Struct, frozen=True, kw_only=True):
    """How points are followed: Lucas and Kanade's method on pyramids, there and back."""

    window_px: int = 17  # side of what is compared
    levels: int = 3  # halvings of the picture
    steps: int = 15  # at most, on each level
    back_max_px: float = 1.0  # that a point may end beside where it began, followed there and back

    def __post_init__(self) -> None:
        """Check ranges."""
        _expect_positive(self, "levels", "steps", "back_max_px")
        _expect(self.window_px >= 5, "window_px: expected >= 5", self.window_px)


class FitConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Which motion is believed."""

    rounds: int = 32  # random samples
    sigma_px: float = 0.7  # standard deviation of where a point is found
    people_sigma_px: float = 3.0  # likewise of one on a person, who hardly ever stands quite still
    gate_sigmas: float = 3.0  # that a point of the room may be off; people are what is farther off
    prior_sigmas: float = 5.0  # that a motion may be off what the one before led to expect
    room_min: int = 4  # points of the room that have to agree, whatever people do
    points_min: int = 12  # that have to agree ...
    share_min: float = 0.4  # ... and of those followed
    # Errors of points close together are alike, so that there is less to average over than it seems
    sigma_factor: float = 2.5  # on the standard deviation of the motion
    sigma_max_m: float = 0.1  # [m] a motion since the keyframe that is less sure is not told
    sigma_max_rad: float = 0.03  # [rad] likewise

    def __post_init__(self) -> None:
        """Check ranges."""
        _expect_positive(self, *(name for name in self.__struct_fields__ if name != "points_min"))
        _expect(self.share_min <= 1, "share_min: expected at most 1", self.share_min)
        _expect(self.room_min >= 3, "room_min: expected >= 3", self.room_min)
        _expect(self.points_min >= 6, "points_min: expected >= 6", self.points_min)


class VisualOdometryConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Configuration of the visual odometry. All values of this record are this project's."""

    camera: str = ""  # the camera whose pictures are taken; empty: the first that sends one
    child_frame_id: str = "base_link"  # frame whose motion is told; the camera is fixed to it
    frame_id: str = "odom"  # frame that it is told in, where a transform tells where in the map ...
    map_id: str = (
        "map"  # ... that lies; else it is told in the map, from where the base stood first
    )
    planar: bool = True  # the base moves on a floor: Odometry; False: any way: MovingTransform
    corners: CornerConfig = CornerConfig()
    flow: FlowConfig = FlowConfig()
    fit: FitConfig = FitConfig()
    # The motion is told from one of some pictures that are kept, so that who stands does not drift
    keyframes: int = 12  # that are kept
    overlap_min: float = 0.5  # share of a keyframe's points that have to be found, else a new one
    # Where a keyframe that is met again lies elsewhere than thought, so much of it is made good
    jump_max_m: float = 0.005  # [m]
    jump_max_rad: float = 0.002  # [rad]
    # time
    predict_s: float = 0.5  # [s] the last motion is thought to go on
    lost_s: float = 0.4  # [s] without any after which a new keyframe begins where that leads
    clock_jump_s: float = 1.0  # [s] a stamp this far back begins a new time; nearer, it is stale
    # Nobody moves like that
    speed_max_mps: float = 4.0  # [m/s]
    turn_max_radps: float = 6.0  # [rad/s]
    # How freely a planar base moves sideways, of how it moves ahead: two driven wheels hardly let
    # it; 1.0 for wheels that roll any way
    sideways: float = 0.05
    # Standard deviations of what a base does: at first, and then
    speed_sigma_mps: float = 0.5  # [m/s]
    turn_sigma_radps: float = 1.0  # [rad/s]
    sigma_acceleration_mps2: float = 1.0  # [m/s^2]
    sigma_turn_radps2: float = 2.0  # [rad/s^2]

    def __post_init__(self) -> None:
        """Check names and ranges."""
        if self.camera:
            check_name("camera", self.camera)
        names = (self.child_frame_id, self.frame_id, self.map_id)
        for name in names:
            check_name("child_frame_id, frame_id, map_id", name)
        _expect(len({*names[:2]}) == 2 and names[0] != names[2], "frames: expected two", names)
        _expect_positive(self, "keyframes", "predict_s", "lost_s", "clock_jump_s", "speed_max_mps")
        _expect_positive(self, "turn_max_radps", "sigma_acceleration_mps2", "sigma_turn_radps2")
        _expect_positive(self, "speed_sigma_mps", "turn_sigma_radps", "sideways")
        _expect_positive(self, "jump_max_m", "jump_max_rad")
        _expect(0 < self.overlap_min < 1, "overlap_min: expected 0 to 1", self.overlap_min)
