"""Scenarios in text files: people, paths, cameras and room."""

import math
from itertools import combinations
from typing import Annotated, Literal

from msgspec import Meta

from common.config import Config
from lab.bodies.cast import child_names, load_cast
from lab.bodies.outfits import Outfit
from lab.camera.plan import CameraPlan, RateHz
from lab.furniture import FurniturePlan, ObjectPlan, Piece
from people4d.messages.base import NonNegative

RoomName = Literal["lab", "hall", "office", "square"]
# Lower and upper corner of the free floor of each room, for centres of people [m]
WALKABLE_M: dict[RoomName, tuple[tuple[float, float], tuple[float, float]]] = {
    "lab": ((-0.3, -1.45), (4.7, 1.45)),
    "hall": ((-0.6, -2.4), (8.4, 2.4)),
    "office": ((-0.5, -2.6), (6.9, 2.6)),
    "square": ((-12.0, -12.0), (12.0, 12.0)),
}
APART_M = 0.5  # minimum distance of two people at the start [m]
BESIDE_M = 0.2  # minimum distance of planned positions from furniture [m]
MAX_CAMERAS = 16  # maximum number of cameras
MAX_PEOPLE = 100  # maximum number of people; masks allow 255

WalkingSpeed = Annotated[float, Meta(ge=0.4, le=1.4)]  # [m/s] range of a natural gait


class Waypoint(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A position on a person's path."""

    to: tuple[float, float]  # [m] x, y, frame: map
    speed_mps: WalkingSpeed | None = None  # [m/s] speed to this position; absent: the person's
    stop_s: NonNegative = 0.0  # [s] duration of the stop
    face_deg: float | None = None  # [deg] yaw during the stop, 0 = +x; absent: on arrival
    sit: bool = False  # True: sits on a stool during the stop
    turn_head: bool = False  # True: turns the head during the stop


class Gesture(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Gesture of an arm, while standing or walking."""

    at_s: NonNegative  # [s] begin
    for_s: float = 4.0  # [s] duration, at least twice `move_s`
    move_s: Annotated[float, Meta(ge=0.5)] = 1.0  # [s] duration of each movement
    hand: Literal["left", "right"] = "right"  # raised hand
    # across the torso; above the head, at rest or waving; forward
    move: Literal["before_torso", "raise", "wave", "point"] = "before_torso"

    def __post_init__(self) -> None:
        """Check the two durations against each other."""
        super().__post_init__()
        if self.for_s < 2 * self.move_s:
            raise ValueError(f"for_s: expected >= {2 * self.move_s}, got {self.for_s}")


class Act(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Movement of the whole body, while standing; without its chair or bed."""

    at_s: NonNegative  # [s] begin
    # bend, squat and fall while standing; sit and lie without a chair or bed
    move: Literal[
        "bend",
        "squat",
        "tie_shoes",
        "sit",
        "sit_tie_shoes",
        "lie",
        "lie_back",
        "lie_in_bed",
        "fall_forward",
        "fall_back",
        "fall_left",
        "fall_right",
        "collapse",
    ]
    move_s: Annotated[float, Meta(ge=0.3)] = 1.5  # [s] duration of each movement, or of a fall
    for_s: NonNegative = 3.0  # [s] stay in the last pose
    stays: bool = False  # True: does not stand up


class PersonPlan(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One person and their path."""

    body: str  # name in the cast, see `people4d lab list`
    start: tuple[float, float]  # [m] x, y, frame: map
    face_deg: float = 180.0  # [deg] initial yaw, 0 = +x
    speed_mps: WalkingSpeed = 1.0  # [m/s] speed of free walking
    wait_s: NonNegative = 0.0  # [s] delay of the first step
    path: tuple[Waypoint, ...] = ()  # positions in order; empty: stands
    repeat: bool = False  # True: the path is repeated
    outfit: Outfit = "own"  # clothes
    size: Annotated[float, Meta(ge=0.8, le=1.2)] = 1.0  # stature relative to the cast
    gestures: tuple[Gesture, ...] = ()  # in order
    acts: tuple[Act, ...] = ()  # in order, while the person stands
    wheelchair: bool = False  # True: sits in a wheelchair all the time

    def __post_init__(self) -> None:
        """Check the name of the body, and that a person in a wheelchair stays in it."""
        super().__post_init__()
        if self.body not in load_cast():
            raise ValueError(f"body: expected one of {', '.join(load_cast())}, got {self.body!r}")
        sits = self.acts or any(waypoint.sit for waypoint in self.path)
        if self.wheelchair and (sits or self.body in child_names()):
            raise ValueError("wheelchair: expected an adult without acts and stools")

    def positions(self) -> tuple[tuple[float, float], ...]:
        """Return the planned positions: x and y in metres, frame: map."""
        return (self.start, *(waypoint.to for waypoint in self.path))


class CapturePlan(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Motion-capture system."""

    rate_hz: RateHz = 100.0  # [Hz] rate of measured poses
    noise_m: Annotated[float, Meta(ge=0, le=1)] = 0.0  # [m] standard deviation of positions, white
    # [deg] standard deviation of yaw, white
    yaw_noise_deg: Annotated[float, Meta(ge=0, le=180)] = 0.0


class Scenario(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Complete description of a simulated recording."""

    name: str = ""  # name of the file
    about: str  # description in one sentence
    duration_s: Annotated[float, Meta(ge=0.05, le=3600)]  # [s] duration of the recording
    # seed of light, textures, noise and small differences between people
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    # lab: 3.5 x 5.5 m, as in [THESIS]; hall: larger, darker; office: desks along an aisle, low
    # ceiling; square: 24 x 26 m
    room: RoomName = "lab"
    furniture: tuple[FurniturePlan, ...] = ()  # pieces of furniture, which people avoid
    objects: tuple[ObjectPlan, ...] = ()  # objects that look like people, which people avoid
    camera: CameraPlan = CameraPlan()
    # further cameras, each with its own name, rate and clock
    cameras: Annotated[tuple[CameraPlan, ...], Meta(max_length=MAX_CAMERAS - 1)] = ()
    capture: CapturePlan = CapturePlan()
    people: Annotated[tuple[PersonPlan, ...], Meta(max_length=MAX_PEOPLE)]

    def __post_init__(self) -> None:
        """Check that cameras differ, positions are free, and people start apart."""
        super().__post_init__()
        names = [plan.name for plan in (self.camera, *self.cameras)]
        if len(set(names)) < len(names):
            raise ValueError(f"cameras: expected different names, got {', '.join(names)}")
        for k, thing in enumerate(self.objects):
            if thing.body not in load_cast():
                cast = ", ".join(load_cast())
                raise ValueError(f"objects[{k}].body: expected one of {cast}, got {thing.body!r}")
        if sum(bool(plan.drive) for plan in (self.camera, *self.cameras)) > 1:
            raise ValueError("cameras: expected at most one driving camera, got more")
        (left, low), (right, high) = WALKABLE_M[self.room]
        for k, person in enumerate(self.people):
            for x, y in person.positions():
                if not (left <= x <= right and low <= y <= high):
                    raise ValueError(
                        f"people[{k}]: expected positions with x {left} to {right} and y {low} to "
                        f"{high}, where the {self.room} is free, got [{x}, {y}]"
                    )
                if any(piece.holds(x, y, BESIDE_M) for piece in self.pieces):
                    raise ValueError(
                        f"people[{k}]: expected positions at least {BESIDE_M} m from furniture, "
                        f"got [{x}, {y}]"
                    )
        for (j, one), (k, other) in combinations(enumerate(self.people), 2):
            if math.dist(one.start, other.start) < APART_M:
                raise ValueError(
                    f"people[{k}]: expected to start at least {APART_M} m from people[{j}], "
                    f"got {list(other.start)}"
                )

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """Furniture and objects."""
        return (*self.furniture, *self.objects)
