"""The chosen person: the person that the robot follows."""

from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from people4d.messages.base import (
    F64,
    MAX_M,
    MAX_STAMP_NS,
    Message,
    Name,
    NonNegative,
    PositiveInt,
    Probability,
    Radians,
    Text,
    Vector2,
    Vector3,
)
from people4d.messages.prediction import HORIZONS_MAX
from people4d.validation import Magnitude, Shape

VALUES = {"id": ("id",), "position_m": ("at",), "name": ("name", "enrol", "forget")}
TargetState = Literal["locked", "occluded", "searching", "lost", "none"]


TargetAction = Literal["id", "nearest", "at", "raised_hand", "name", "none", "enrol", "forget"]
# Types of fields that are checked when a command is made; arrays are checked by every message
TYPES = {"action": TargetAction, "id": int | None, "name": str | None, "chooser": str}


class TargetCommand(Message, frozen=True, kw_only=True):
    """Choice of the person to follow; the newest choice is in force."""

    # id: the track `id`; nearest: the nearest person to the robot; at: the nearest person within
    # 1 m of `position_m`; raised_hand: the nearest person with a hand raised for 1 s; name: the
    # person enrolled as `name`; none: no person; enrol: store the locked person's views as `name`;
    # forget: delete them, and end a choice of that person
    action: TargetAction
    id: PositiveInt | None = None  # identity as in Tracks; absent unless action is id
    # [m] x, y on the ground, frame: frame of Tracks; absent unless action is at
    position_m: Vector2 | None = None
    name: Name | None = None  # absent unless action is name, enrol or forget
    chooser: Annotated[Text, Meta(max_length=64)] = ""  # name of the chooser; empty: unnamed

    def __post_init__(self) -> None:
        """Check the fields and their types, and that the action has its value."""
        for field, kind in TYPES.items():
            try:
                msgspec.convert(getattr(self, field), kind)
            except msgspec.ValidationError as error:
                raise ValueError(f"{field}: {error}") from error
        if self.position_m is not None and not isinstance(self.position_m, np.ndarray):
            raise ValueError("position_m: expected an array of NumPy")
        super().__post_init__()
        for field, actions in VALUES.items():
            if (getattr(self, field) is None) == (self.action in actions):
                given = "a value" if self.action in actions else "none"
                raise ValueError(f"{field}: expected {given} with the action {self.action!r}")


class Target(Message, frozen=True, kw_only=True):
    """The chosen person at one frame of Tracks; with state none, too."""

    # locked: visible; occluded: hidden for a moment, predicted; searching: not visible, or not
    # certain; lost: searching for longer than `lost_after_s`; none: no person is chosen
    state: TargetState
    frame_id: Name  # frame of positions, as in Tracks
    camera: Name  # camera of the Tracks of this stamp
    id: PositiveInt | None = None  # identity as in Tracks; absent unless locked or occluded
    position_m: Vector3 | None = None  # [m] frame: frame_id; absent unless locked or occluded
    # [m/s] frame: frame_id; absent unless locked or occluded
    velocity_mps: Vector3 | None = None
    # probability that the track, or else the likeliest visible person, is the chosen person
    probability: Probability = 0.0
    reason: Text = ""  # reason of the state
    # [m] distance on the ground from the robot's base; absent unless locked or occluded, and if the
    # pose of the base is unknown
    distance_m: NonNegative | None = None
    # [rad] direction from the robot's base, 0 = ahead, counter-clockwise; absent like distance_m
    bearing_rad: Radians | None = None
    stop: bool = True  # True: do not move; False if locked or occluded
    # [s] times ahead of the stamp of the predicted path; empty without a prediction
    path_times_s: Annotated[tuple[NonNegative, ...], Meta(max_length=HORIZONS_MAX)] = ()
    # [m] predicted x, y at path_times_s, frame: frame_id; absent without a prediction
    path_m: Annotated[F64, Shape("H", 2), Magnitude(MAX_M)] | None = None
    chooser: Text = ""  # name of the chooser in force; empty: unnamed
    # [ns] stamp of the last command; absent: none
    answered_ns: Annotated[int, Meta(ge=-MAX_STAMP_NS, le=MAX_STAMP_NS)] | None = None
    # reason why that command, enrol or forget, was not executed; empty if it was
    problem: Text = ""

    def __post_init__(self) -> None:
        """Check the fields, and that each time of the path has a position."""
        super().__post_init__()
        size = 0 if self.path_m is None else len(self.path_m)
        if size != len(self.path_times_s):
            raise ValueError(f"path_m: expected {len(self.path_times_s)} positions, got {size}")
