"""Predictions: paths of people in the next seconds, and groups of people."""

from typing import Annotated, Literal

from msgspec import Meta

from people4d.messages.base import (
    F64,
    MAX_COVARIANCE,
    MAX_M,
    Message,
    Name,
    NonNegative,
    PositiveInt,
    Probability,
    Record,
    Vector2,
    Vector3,
)
from people4d.validation import Magnitude, Shape

HORIZONS_MAX = 64
Horizon = Annotated[float, Meta(gt=0, le=3600)]


class MotionProbabilities(Record, frozen=True, kw_only=True):
    """Probabilities of a person's next 3 seconds; they sum to 1."""

    standing: Probability  # probability of staying within 0.6 m
    # probability of leaving that circle within 25 deg of the current direction of walking
    going_on: Probability
    turning: Probability  # probability of leaving it in another direction, or of starting to walk


class RobotEncounter(Record, frozen=True, kw_only=True):
    """Encounter of a person with the robot if the robot keeps its current velocity."""

    # [s] time from the stamp to the closest approach of the expected positions, within the horizons
    closest_approach_s: NonNegative
    closest_distance_m: NonNegative  # [m] distance between the expected positions at that time
    # [m] minimum distance of the person's expected path to the robot's path, at any time
    path_distance_m: NonNegative


class PersonPrediction(Record, frozen=True, kw_only=True):
    """One person's future on the ground: a mean and a covariance at each horizon."""

    id: PositiveInt  # as in Tracks
    state: Literal["tentative", "confirmed", "lost"]  # as in Tracks; lost: occluded
    position_m: Vector3  # [m] at the stamp, frame: Predictions.frame_id
    velocity_mps: Vector2  # [m/s] x, y at the stamp, smoothed; frame: Predictions.frame_id
    motion: MotionProbabilities  # motion in the next 3 s
    # [m] x, y at each of Predictions.horizons_s; frame: Predictions.frame_id
    means_m: Annotated[F64, Shape("H", 2), Magnitude(MAX_M)]
    # [m^2] of x, y at each of Predictions.horizons_s; frame: Predictions.frame_id
    covariances_m2: Annotated[F64, Shape("H", 2, 2), Magnitude(MAX_COVARIANCE)]
    # number of the group that walks or stands together, constant while two members stay; absent if
    # alone
    group: PositiveInt | None = None
    robot: RobotEncounter | None = None  # absent if the motion of the robot is unknown

    def __post_init__(self) -> None:
        """Check the fields, and that the covariances are symmetric and positive definite."""
        super().__post_init__()
        if len(self.means_m) != len(self.covariances_m2):
            raise ValueError(
                f"covariances_m2: expected {len(self.means_m)}, one a mean, "
                f"got {len(self.covariances_m2)}"
            )
        # Faster than arrays for a few horizons.
        for a, b, c, d in self.covariances_m2.reshape(-1, 4).tolist():
            if b != c or not (a > 0 and a * d > b * c):
                raise ValueError("covariances_m2: expected symmetric and positive definite")


class Predictions(Message, frozen=True, kw_only=True):
    """Predicted paths of the people around the robot, hidden ones included."""

    frame_id: Name  # frame of positions, as in Tracks
    camera: Name  # camera of the Tracks of the same stamp, from which paths are predicted
    # [s] ahead of the stamp, increasing
    horizons_s: Annotated[tuple[Horizon, ...], Meta(min_length=1, max_length=HORIZONS_MAX)]
    people: tuple[PersonPrediction, ...] = ()  # each id once, in the order of Tracks
    # [m] x, y of the robot's base at each horizon if it keeps its velocity; absent if unknown
    robot_m: Annotated[F64, Shape("H", 2), Magnitude(MAX_M)] | None = None

    def __post_init__(self) -> None:
        """Check the fields, the order of the horizons, and one prediction for each horizon."""
        super().__post_init__()
        if any(b <= a for a, b in zip(self.horizons_s, self.horizons_s[1:], strict=False)):
            raise ValueError(f"horizons_s: expected increasing, got {list(self.horizons_s)}")
        size = len(self.horizons_s)
        if self.robot_m is not None and len(self.robot_m) != size:
            raise ValueError(f"robot_m: expected {size} positions, got {len(self.robot_m)}")
        for person in self.people:
            if len(person.means_m) != size:
                raise ValueError(f"means_m: expected {size} positions, got {len(person.means_m)}")
        if len({person.id for person in self.people}) < len(self.people):
            raise ValueError("people: expected each id once")
