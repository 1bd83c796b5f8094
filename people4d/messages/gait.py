"""Gait of people: points of their bodies, and measures from their feet."""

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

    name: Name  # head, left_hand, right_hand, left_foot, right_foot, or as configured
    # measured in this frame; predicted: hidden, extrapolated; lost: at its last position
    state: Literal["measured", "predicted", "lost"]
    position_m: Vector3  # [m] frame: Gait.frame_id
    velocity_mps: Vector3  # [m/s] frame: Gait.frame_id, of the point in that frame
    covariance: Matrix6  # [m, m/s] of position and velocity, frame: Gait.frame_id
    confidence: Probability  # confidence that the position is on this point of the body


class GaitMeasures(Record, frozen=True, kw_only=True):
    """Gait of a person over the last seconds; empty while standing."""

    steps: Count = 0  # number of steps in these seconds
    step_length_m: float | None = None  # [m] along the path, from one foot to the other; or absent
    # [m] distance of consecutive contacts of a foot; absent until known
    stride_length_m: float | None = None
    cadence_per_min: float | None = None  # [1/min] steps a minute; absent until known
    walking_speed_mps: float | None = None  # [m/s] along the path; absent until known
    # (left - right) / mean of step times, a left step ending with the left foot; absent until known
    step_time_asymmetry: float | None = None


class PersonGait(Record, frozen=True, kw_only=True):
    """One person's points and measures in one frame."""

    id: PositiveInt  # as in Tracks
    measures: GaitMeasures  # measures of the last seconds, including this frame
    # [px] left, top, right, bottom; may reach beyond the image; absent if unknown
    box_xyxy_px: Box | None = None
    points: tuple[BodyPoint, ...] = ()  # each name once

    def __post_init__(self) -> None:
        """Check the fields, and that each name of a point comes once."""
        super().__post_init__()
        names = [point.name for point in self.points]
        if len(set(names)) < len(names):
            raise ValueError(f"points: expected each name once, got {names}")


class Gait(Message, frozen=True, kw_only=True):
    """Gait of the people before a camera; frames are skipped when the service is busy."""

    frame_id: Name  # frame of points
    camera: Name  # camera whose frame was measured
    people: tuple[PersonGait, ...] = ()  # nearest first; limited by the time for a frame
