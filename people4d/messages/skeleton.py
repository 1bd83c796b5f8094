"""Skeletons: the joints of people in 3D."""

from typing import Annotated, Literal, get_args

from people4d.messages.base import (
    F32,
    MAX_COVARIANCE,
    MAX_M,
    Message,
    Name,
    Positive,
    PositiveInt,
    Probability,
    Record,
)
from people4d.validation import Magnitude, Shape

# The order of keypoints (COCO)
JOINTS = (
    *("nose", "left_eye", "right_eye", "left_ear", "right_ear"),
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    *("left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"),
)

Posture = Literal["standing", "walking", "sitting", "lying", "bending", "unknown"]
POSTURES: tuple[Posture, ...] = get_args(Posture)


class PersonSkeleton(Record, frozen=True, kw_only=True):
    """One person's joints, 17 in COCO order, inside the body, not on its surface."""

    id: PositiveInt  # as in Tracks
    state: Literal["tentative", "confirmed", "lost"]  # as in Tracks; lost: all joints are predicted
    # [m] of each joint, frame: Skeletons.frame_id
    positions_m: Annotated[F32, Shape(17, 3), Magnitude(MAX_M)]
    # [m^2] covariance of each joint, frame: Skeletons.frame_id
    covariances_m2: Annotated[F32, Shape(17, 3, 3), Magnitude(MAX_COVARIANCE)]
    # True for each joint visible in this frame, False if hidden and predicted
    measured: tuple[bool, ...]
    posture: Posture = "unknown"  # bending: also squatting and kneeling
    posture_probability: Probability = 0.0  # probability of the posture; 0 if it is unknown
    # [m] height from sole to crown by the lengths of bones; absent: unknown
    stature_m: Positive | None = None
    stature_sigma_m: Positive | None = None  # [m] its standard deviation
    child: Probability = 0.0  # probability of a stature below 1.45 m, as of a child
    # probability of an object: a poster, a screen, or a figure that never moves
    object_like: Probability = 0.0

    def __post_init__(self) -> None:
        """Check the fields, and that `measured` has one value per joint."""
        super().__post_init__()
        if len(self.measured) != len(JOINTS):
            raise ValueError(f"measured: expected {len(JOINTS)}, got {len(self.measured)}")


class Skeletons(Message, frozen=True, kw_only=True):
    """Skeletons of the people in one frame, including hidden people."""

    frame_id: Name  # frame of joints, as in Tracks
    camera: Name  # camera whose frame was measured
    people: tuple[PersonSkeleton, ...] = ()  # each id once, in the order of Tracks
