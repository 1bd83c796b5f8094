"""How people walk: points of their bodies, and what follows from their feet."""

from typing import Literal

from people4d.messages.base import (
    Box,
    Count,
    Matrix6,
    Message,
    Name,
    PositiveInt,
    Probability,
    Record,
    Vector3,
)


class BodyPoint(Record, frozen=True, kw_only=True):
    """One point on the surface of a person's body."""

    name: Name  # head, left_hand, right_hand, left_foot, right_foot, or as the user calls it
    # measured: seen in this frame; predicted: hidden, where it was going; lost: where it was last
    state: Literal["measured", "predicted", "lost"]
    position_m: Vector3  # [m] 3, frame: Gait.frame_id
    velocity_mps: Vector3  # [m/s] 3, frame: Gait.frame_id, of the point in that frame
    covariance: Matrix6  # [m, m/s] 6x6 of position and velocity, frame: Gait.frame_id
    confidence: Probability  # that it is this point of the body, 0 to 1


class GaitMeasures(Record, frozen=True, kw_only=True):
    """How a person walked in the last seconds; who stands has none of it."""

    steps: Count = 0  # that the figures are of
    step_length_m: float | None = None  # [m] along the way, from one foot to the other; or absent
    stride_length_m: float | None = None  # [m] from one place of a foot to its next one; or absent
    cadence_per_min: float | None = None  # [1/min] steps a minute; absent until known
    walking_speed_mps: float | None = None  # [m/s] along the way; absent until known
    # (left - right) / mean of step times, a left step ending with the left foot; absent until known
    step_time_asymmetry: float | None = None


class PersonGait(Record, frozen=True, kw_only=True):
    """One person's points and measures in one frame."""

    id: PositiveInt  # as in Tracks
    measures: GaitMeasures  # of the last seconds, this frame included
    # [px] 4: left, top, right, bottom; may reach beyond the image; absent: nobody knows where
    box_xyxy_px: Box | None = None
    points: tuple[BodyPoint, ...] = ()  # each name once

    def __post_init__(self) -> None:
        """Check the fields, and that each name of a point comes once."""
        super().__post_init__()
        names = [point.name for point in self.points]
        if len(set(names)) < len(names):
            raise ValueError(f"points: expected each name once, got {names}")


class Gait(Message, frozen=True, kw_only=True):
    """How the people before a camera walk: a message for every frame that there is time for."""

    frame_id: Name  # frame that points are in
    camera: Name  # camera whose frame they were found in
    people: tuple[PersonGait, ...] = ()  # nearest first; not more than there is time for
