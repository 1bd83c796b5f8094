"""How people walk: points of their bodies, and what follows from their feet."""

from typing import Literal

import msgspec

from people4d.messages.base import F32, F64, Message, check_finite, check_name, check_shape


class BodyPoint(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One point on the surface of a person's body."""

    name: str  # head, left_hand, right_hand, left_foot, right_foot, or as the user calls it
    # measured: seen in this frame; predicted: hidden, where it was going; lost: where it was last
    state: Literal["measured", "predicted", "lost"]
    position_m: F64  # [m] 3, frame: Gait.frame_id
    velocity_mps: F64  # [m/s] 3, frame: Gait.frame_id, of the point in that frame
    covariance: F64  # [m, m/s] 6x6 of position and velocity, frame: Gait.frame_id
    confidence: float  # that it is this point of the body, 0 to 1

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        check_name("name", self.name)
        check_shape("position_m", self.position_m, (3,))
        check_shape("velocity_mps", self.velocity_mps, (3,))
        check_shape("covariance", self.covariance, (6, 6))
        check_finite("position_m, velocity_mps", self.position_m, self.velocity_mps)
        check_finite("covariance", self.covariance)
        if not 0 <= self.confidence <= 1:
            raise ValueError(f"confidence: expected 0 to 1, got {self.confidence}")


class GaitMeasures(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a person walked in the last seconds; who stands has none of it."""

    steps: int = 0  # that the figures are of
    step_length_m: float | None = None  # [m] along the way, from one foot to the other; or absent
    stride_length_m: float | None = None  # [m] from one place of a foot to its next one; or absent
    cadence_per_min: float | None = None  # [1/min] steps a minute; absent until known
    walking_speed_mps: float | None = None  # [m/s] along the way; absent until known
    # (left - right) / mean of step times, a left step ending with the left foot; absent until known
    step_time_asymmetry: float | None = None

    def __post_init__(self) -> None:
        """Check numbers."""
        if self.steps < 0:
            raise ValueError(f"steps: expected >= 0, got {self.steps}")
        check_finite("step_length_m, stride_length_m", self.step_length_m, self.stride_length_m)
        check_finite("cadence_per_min", self.cadence_per_min)
        check_finite("walking_speed_mps", self.walking_speed_mps)
        check_finite("step_time_asymmetry", self.step_time_asymmetry)


class PersonGait(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One person's points and measures in one frame."""

    id: int  # as in Tracks
    measures: GaitMeasures  # of the last seconds, this frame included
    # [px] 4: left, top, right, bottom; may reach beyond the image; absent: nobody knows where
    box_xyxy_px: F32 | None = None
    points: tuple[BodyPoint, ...] = ()  # each name once

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        check_shape("box_xyxy_px", self.box_xyxy_px, (4,))
        check_finite("box_xyxy_px", self.box_xyxy_px)
        names = [point.name for point in self.points]
        if self.id < 1 or len(set(names)) < len(names):
            raise ValueError(
                f"id, points: expected id >= 1 and each name once, got {self.id} and {names}"
            )


class Gait(Message, frozen=True, kw_only=True):
    """How the people before a camera walk: a message for every frame that there is time for."""

    frame_id: str  # frame that points are in
    camera: str  # camera whose frame they were found in
    people: tuple[PersonGait, ...] = ()  # nearest first; not more than there is time for

    def __post_init__(self) -> None:
        """Check names."""
        super().__post_init__()
        check_name("frame_id", self.frame_id)
        check_name("camera", self.camera)
