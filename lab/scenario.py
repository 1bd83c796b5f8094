"""Scenarios: people, their paths, the camera and the room, in text files that anyone can add."""

import math
from itertools import combinations, pairwise
from typing import Annotated, Literal

from msgspec import Meta

from common.config import Config
from lab.bodies.cast import cast_names
from lab.bodies.outfits import Outfit
from lab.camera.plan import CameraPlan, RateHz
from lab.furniture import FurniturePlan
from people4d.messages.base import NonNegative

RoomName = Literal["lab", "hall", "office", "square"]
# [m] lower and upper corner of the floor that is free in each room, for the middle of a person.
WALKABLE_M: dict[RoomName, tuple[tuple[float, float], tuple[float, float]]] = {
    "lab": ((-0.3, -1.45), (4.7, 1.45)),
    "hall": ((-0.6, -2.4), (8.4, 2.4)),
    "office": ((-0.5, -2.6), (6.9, 2.6)),
    "square": ((-12.0, -12.0), (12.0, 12.0)),
}
APART_M = 0.5  # between two people at the start
BESIDE_M = 0.2  # between the middle of a person and furniture, at the positions of a plan
MAX_CAMERAS = 16  # in one world
MAX_PEOPLE = 100  # the image of owners has room for 255

WalkingSpeed = Annotated[float, Meta(ge=0.4, le=1.4)]  # [m/s] in which the walk is true to life


class Waypoint(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A position on a person's path."""

    to: tuple[float, float]  # [m] x, y, frame: map
    speed_mps: WalkingSpeed | None = None  # [m/s] on the path there; None: the person's own
    stop_s: NonNegative = 0.0  # [s] to stay there; 0: walk on without stopping
    face_deg: float | None = None  # [deg] to face while there, 0 = +x; None: as arrived
    sit: bool = False  # sit down while there (on a stool, which the scenario adds there)
    turn_head: bool = False  # turn the head while there


class Gesture(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An arm that is moved on purpose, standing or walking, and then hangs again."""

    at_s: NonNegative  # [s] when it begins
    for_s: float = 4.0  # [s] until the arm is back, at least twice `move_s`
    move_s: Annotated[float, Meta(ge=0.5)] = 1.0  # [s] to move it there, and to move it back
    hand: Literal["left", "right"] = "right"
    move: Literal["before_torso", "raise"] = "before_torso"  # across the torso; above the head

    def __post_init__(self) -> None:
        """Check the two durations against each other."""
        super().__post_init__()
        if self.for_s < 2 * self.move_s:
            raise ValueError(f"for_s: expected >= {2 * self.move_s}, got {self.for_s}")


class WalkStyle(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Walking style of a person, by default that of most people."""

    # (left - right) / mean of the times of steps; above 0 the right foot is spared
    limp: Annotated[float, Meta(ge=-0.4, le=0.4)] = 0.0
    cadence: Annotated[float, Meta(ge=0.7, le=1.4)] = 1.0  # over the usual at that speed
    lean_deg: Annotated[float, Meta(ge=0, le=35)] = 0.0  # [deg] of the chest, forward
    # carry: both forearms held before the body, as with a box
    arms: Literal["swing", "pockets", "carry"] = "swing"


class PersonPlan(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One person and their path."""

    body: str  # name in the cast, see `people4d lab list`
    start: tuple[float, float]  # [m] x, y, frame: map
    face_deg: float = 180.0  # [deg] faced at the start, 0 = +x
    speed_mps: WalkingSpeed = 1.0  # [m/s] of free walking
    wait_s: NonNegative = 0.0  # [s] to stand before the first step
    path: tuple[Waypoint, ...] = ()  # in order; empty: stands all the time
    repeat: bool = False  # begin the path anew at its end
    # [s, m, m] time, x and y of a recorded path that is followed in place of start and path
    trajectory: tuple[tuple[float, float, float], ...] = ()
    outfit: Outfit = "own"  # clothes
    size: Annotated[float, Meta(ge=0.8, le=1.2)] = 1.0  # stature over that in the cast
    gestures: tuple[Gesture, ...] = ()
    style: WalkStyle = WalkStyle()

    def __post_init__(self) -> None:
        """Check the name of the body, and the times of a trajectory."""
        super().__post_init__()
        if self.body not in cast_names():
            raise ValueError(f"body: expected one of {', '.join(cast_names())}, got {self.body!r}")
        if any(after[0] <= before[0] for before, after in pairwise(self.trajectory)):
            raise ValueError("trajectory: expected times that rise")

    def positions(self) -> tuple[tuple[float, float], ...]:
        """Return the planned positions: x and y in metres, frame: map."""
        if self.trajectory:
            return tuple((x, y) for _, x, y in self.trajectory)
        return (self.start, *(waypoint.to for waypoint in self.path))


class CapturePlan(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The motion-capture system."""

    rate_hz: RateHz = 100.0  # [Hz]
    noise_m: Annotated[float, Meta(ge=0, le=1)] = 0.0  # [m] sigma of positions, white
    yaw_noise_deg: Annotated[float, Meta(ge=0, le=180)] = 0.0  # [deg] sigma of yaw, white
    # share of time a person is not captured, in gaps of `dropout_s`
    dropout: Annotated[float, Meta(ge=0, le=0.99)] = 0.0
    dropout_s: Annotated[float, Meta(ge=0.01, le=3600)] = 0.5  # [s] mean length of a gap
    clock_offset_s: float = 0.0  # [s] its clock minus the camera's


class Scenario(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A complete description of a simulated recording."""

    name: str = ""  # of the file
    about: str  # one sentence
    duration_s: Annotated[float, Meta(ge=0.05, le=3600)]  # [s]
    # of light, textures, noise and the small differences between people
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    # lab: 3.5 x 5.5 m, as that of [THESIS]; hall: larger, darker
    # office: desks beside an aisle under a low ceiling; square: 24 x 26 m
    room: RoomName = "lab"
    furniture: tuple[FurniturePlan, ...] = ()  # further pieces, which people walk round
    camera: CameraPlan = CameraPlan()
    # further cameras in the same world, each with its own name, rate and clock
    cameras: Annotated[tuple[CameraPlan, ...], Meta(max_length=MAX_CAMERAS - 1)] = ()
    capture: CapturePlan = CapturePlan()
    people: Annotated[tuple[PersonPlan, ...], Meta(max_length=MAX_PEOPLE)]

    def __post_init__(self) -> None:
        """Check that cameras differ, positions are free, and people start apart."""
        super().__post_init__()
        names = [plan.name for plan in (self.camera, *self.cameras)]
        if len(set(names)) < len(names):
            raise ValueError(f"cameras: expected a name each, got {', '.join(names)}")
        if sum(bool(plan.drive) for plan in (self.camera, *self.cameras)) > 1:
            raise ValueError("cameras: expected at most one that drives, got more")
        (left, low), (right, high) = WALKABLE_M[self.room]
        recorded = [k for k, person in enumerate(self.people) if person.trajectory]
        if recorded and len(recorded) < len(self.people):
            raise ValueError(f"people[{recorded[0]}]: expected a trajectory of all or of none")
        for k, person in enumerate(self.people):
            for x, y in person.positions():
                if not (left <= x <= right and low <= y <= high):
                    raise ValueError(
                        f"people[{k}]: expected positions with x {left} to {right} and y {low} to "
                        f"{high}, where the {self.room} is free, got [{x}, {y}]"
                    )
                if not recorded and any(piece.holds(x, y, BESIDE_M) for piece in self.furniture):
                    raise ValueError(
                        f"people[{k}]: expected positions at least {BESIDE_M} m from furniture, "
                        f"got [{x}, {y}]"
                    )
        if recorded:
            return
        for (j, one), (k, other) in combinations(enumerate(self.people), 2):
            if math.dist(one.start, other.start) < APART_M:
                raise ValueError(
                    f"people[{k}]: expected to start at least {APART_M} m from people[{j}], "
                    f"got {list(other.start)}"
                )
