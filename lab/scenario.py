"""Scenarios: who walks where, seen by which camera, in which room; text files anyone can add."""

import math
import re
import tomllib
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

import msgspec

from common.config import setting
from lab.bodies.cast import cast_names
from people4d.errors import ConfigError
from people4d.messages.base import check_name

FOLDER = Path(__file__).parent / "scenarios"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
# [m] lower and upper corner of the floor that is free in each room, for the middle of a person.
WALKABLE_M = {
    "lab": ((-0.3, -1.45), (4.7, 1.45)),
    "hall": ((-0.6, -2.4), (8.4, 2.4)),
}
SPEEDS_MPS = (0.4, 1.4)  # in which the walk is true to life
APART_M = 0.5  # between two people at the start
MAX_PEOPLE = 100  # the image that says who owns each pixel has room for 255
PREFIX = "lab:"
TRUTH = "lab.source:LabTruth"


def _check(field: str, value: float, least: float, most: float) -> None:
    if not least <= value <= most:
        raise ValueError(f"{field}: expected {least} to {most}, got {value}")


class Waypoint(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A place on a person's way."""

    to: tuple[float, float]  # [m] x, y, frame: map
    speed_mps: float | None = None  # [m/s] on the way there; None: the person's own
    stop_s: float = 0.0  # [s] to stay there; 0: walk on without stopping
    face_deg: float | None = None  # [deg] to face while there, 0 = +x; None: as arrived
    sit: bool = False  # sit down while there (on a stool, which the scenario places there)
    look_around: bool = False  # turn the head while there

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.speed_mps is not None:
            _check("speed_mps", self.speed_mps, *SPEEDS_MPS)
        _check("stop_s", self.stop_s, 0, math.inf)


class Gesture(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An arm that is moved on purpose, standing or walking, and then hangs again."""

    at_s: float  # [s] when it begins
    for_s: float = 4.0  # [s] until the arm is back
    move_s: float = 1.0  # [s] to move it there, and to move it back
    hand: Literal["left", "right"] = "right"
    move: Literal["before_torso", "raise"] = "before_torso"  # across the trunk; above the head

    def __post_init__(self) -> None:
        """Check the numbers."""
        _check("at_s", self.at_s, 0, math.inf)
        _check("move_s", self.move_s, 0.5, math.inf)
        _check("for_s", self.for_s, 2 * self.move_s, math.inf)


class PersonPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One person and their way."""

    body: str  # name in the cast, see `people4d lab list`
    start: tuple[float, float]  # [m] x, y, frame: map
    face_deg: float = 180.0  # [deg] faced at the start, 0 = +x
    speed_mps: float = 1.0  # [m/s] of free walking, 0.4 to 1.4
    wait_s: float = 0.0  # [s] to stand before the first step
    path: tuple[Waypoint, ...] = ()  # in order; empty: stands all the time
    repeat: bool = False  # begin the path anew at its end
    gestures: tuple[Gesture, ...] = ()

    def __post_init__(self) -> None:
        """Check name and numbers."""
        if self.body not in cast_names():
            raise ValueError(f"body: expected one of {', '.join(cast_names())}, got {self.body!r}")
        _check("speed_mps", self.speed_mps, *SPEEDS_MPS)
        _check("wait_s", self.wait_s, 0, math.inf)


class Drive(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A stretch of the robot's way; speed and turn change smoothly from one to the next."""

    for_s: float  # [s]
    speed_mps: float = 0.0  # [m/s] forward
    turn_dps: float = 0.0  # [deg/s] counter-clockwise

    def __post_init__(self) -> None:
        """Check the numbers."""
        _check("for_s", self.for_s, 0.05, math.inf)
        _check("speed_mps", self.speed_mps, -2, 2)
        _check("turn_dps", self.turn_dps, -360, 360)


class WheelPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The wheel encoders of the robot."""

    rate_hz: float = 50.0  # [Hz]
    radius_m: float = 0.0325  # [m] of each wheel
    track_m: float = 0.30  # [m] between the wheels
    ticks_per_turn: int = 4096  # of a wheel
    scale_error: float = 0.01  # relative error of the radius, both wheels alike
    track_error: float = 0.01  # relative error of the wheel track: turns come out too large
    slip: float = 0.02  # standard deviation of each wheel's relative slip, drawn anew every second

    def __post_init__(self) -> None:
        """Check the numbers."""
        _check("rate_hz", self.rate_hz, 1, 1000)
        _check("radius_m", self.radius_m, 0.005, 1)
        _check("track_m", self.track_m, 0.01, 5)
        _check("ticks_per_turn", self.ticks_per_turn, 1, 2**31)
        _check("scale_error", self.scale_error, -0.5, 0.5)
        _check("track_error", self.track_error, -0.5, 0.5)
        _check("slip", self.slip, 0, 0.5)


class CameraPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The camera; on a robot if it drives."""

    name: str = "front"
    at: tuple[float, float, float] = (0.0, 0.0, 1.15)  # [m] x, y, z at the start, frame: map
    yaw_deg: float = 0.0  # [deg] at the start, 0 = +x
    pitch_deg: float = 3.0  # [deg] downward
    width: int = 640  # [px]
    height: int = 480  # [px]
    focal_px: float = 615.0  # [px] both ways, as a D435i's colour image of 640x480
    fps: float = 30.0  # [Hz]
    exposure_s: float = 0.0  # [s] shutter time that blurs motion; 0: none
    drive: tuple[Drive, ...] = ()  # the robot's way; empty: the camera stands still
    wheels: WheelPlan = WheelPlan()

    def __post_init__(self) -> None:
        """Check name and numbers."""
        check_name("name", self.name)
        _check("width", self.width, 16, 4096)
        _check("height", self.height, 16, 4096)
        _check("focal_px", self.focal_px, 10, 10000)
        _check("fps", self.fps, 1, 120)
        _check("exposure_s", self.exposure_s, 0, 1 / self.fps)
        _check("pitch_deg", self.pitch_deg, -80, 80)


class CapturePlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The motion-capture system."""

    rate_hz: float = 100.0  # [Hz]
    noise_m: float = 0.0  # [m] standard deviation of positions, white
    yaw_noise_deg: float = 0.0  # [deg] standard deviation of yaw, white
    dropout: float = 0.0  # share of time a person is not captured, in gaps of `dropout_s`
    dropout_s: float = 0.5  # [s] mean length of a gap
    clock_offset_s: float = 0.0  # [s] its clock minus the camera's

    def __post_init__(self) -> None:
        """Check the numbers."""
        _check("rate_hz", self.rate_hz, 1, 1000)
        _check("noise_m", self.noise_m, 0, 1)
        _check("yaw_noise_deg", self.yaw_noise_deg, 0, 180)
        _check("dropout", self.dropout, 0, 0.99)
        _check("dropout_s", self.dropout_s, 0.01, 3600)


class Scenario(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All that a simulated recording depends on."""

    name: str = ""  # of the file
    about: str  # one sentence
    duration_s: float  # [s]
    seed: int = 0  # of light, textures, noise and the small differences between people
    room: Literal["lab", "hall"] = "lab"  # lab: 3.5 x 5.5 m, as the thesis'; hall: larger, darker
    camera: CameraPlan = CameraPlan()
    capture: CapturePlan = CapturePlan()
    people: tuple[PersonPlan, ...]

    def __post_init__(self) -> None:
        """Check numbers and places.

        Raises:
            ValueError: A value is out of range.
        """
        for field, value in _numbers("", msgspec.to_builtins(self)):
            if not math.isfinite(value):
                raise ValueError(f"{field}: expected a finite number, got {value}")
        _check("duration_s", self.duration_s, 0.05, 3600)
        _check("seed", self.seed, 0, 2**63 - 1)
        _check("number of people", len(self.people), 0, MAX_PEOPLE)
        self._check_places()

    def _check_places(self) -> None:
        """Check that places are free, and that nobody starts inside another."""
        (left, low), (right, high) = WALKABLE_M[self.room]
        for k, person in enumerate(self.people):
            for x, y in (person.start, *(waypoint.to for waypoint in person.path)):
                if not (left <= x <= right and low <= y <= high):
                    raise ValueError(
                        f"people[{k}]: expected places with x {left} to {right} and y {low} to "
                        f"{high}, where the {self.room} is free, got [{x}, {y}]"
                    )
        for (j, one), (k, other) in combinations(enumerate(self.people), 2):
            if math.dist(one.start, other.start) < APART_M:
                raise ValueError(
                    f"people[{k}]: expected to start at least {APART_M} m from people[{j}], "
                    f"got {list(other.start)}"
                )


def _numbers(field: str, value: Any) -> Iterator[tuple[str, float]]:
    """Yield all numbers of a tree of dictionaries and lists with their names."""
    if isinstance(value, float):
        yield field, value
    items = value.items() if isinstance(value, dict) else ()
    for name, part in items:
        yield from _numbers(f"{field}.{name}".lstrip("."), part)
    for index, part in enumerate(value if isinstance(value, list | tuple) else ()):
        yield from _numbers(f"{field}[{index}]", part)


def scenario_names() -> list[str]:
    """Return the names of the scenarios that ship."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_scenario(name: str) -> Scenario:
    """Read a scenario that ships by its name, or any by the path of its file.

    Raises:
        ConfigError: There is none, or it cannot be read.
    """
    path = FOLDER / f"{name}.toml" if NAME.fullmatch(name) else Path(name)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        return msgspec.convert({**data, "name": path.stem}, Scenario)
    except FileNotFoundError as error:
        names = ", ".join(scenario_names())
        raise ConfigError(f"there is no scenario {name}", f"There are {names}.") from error
    except OSError as error:
        raise ConfigError(f"scenario {path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        hint = f"Compare it with those that ship, in {FOLDER}."
        raise ConfigError(f"scenario {path}: {error}", hint) from error


def split_seed(name: str) -> tuple[str, int | None]:
    """Split the name or path of a scenario from the seed that may follow it, NAME@SEED.

    Raises:
        ConfigError: What follows is no seed.
    """
    scenario, separator, seed = name.rpartition("@")
    if not separator:
        return name, None
    if not seed.isdecimal():
        raise ConfigError(f"scenario {name}: expected a whole number after @, got {seed!r}")
    return scenario, int(seed)


def is_scenario(source: str) -> bool:
    """Tell whether a source is a scenario."""
    return source.startswith(PREFIX)


def resolve(source: str) -> str:
    """Return the source with an absolute path, since services run in another folder.

    Raises:
        ConfigError: There is no such scenario; told before anything is started.
    """
    name, _ = split_seed(source.removeprefix(PREFIX))
    load_scenario(name)
    if NAME.fullmatch(name):
        return source
    return PREFIX + str(Path(source.removeprefix(PREFIX)).absolute())


def truth_settings(truth: str, loop: bool) -> list[str]:
    """Return the settings with which the ground-truth bridge tells what is true in a scenario.

    Args:
        truth: The scenario.
        loop: It is played again and again.
    """
    settings = [setting("gt_bridge.source", TRUTH)]
    if loop:
        name, _ = split_seed(truth.removeprefix(PREFIX))
        settings.append(f"gt_bridge.loop_s={round_s(load_scenario(name))}")
    return settings


def round_s(scenario: Scenario) -> float:
    """Return what a camera that plays a scenario again and again adds to its stamps [s]."""
    return round(scenario.duration_s * scenario.camera.fps) / scenario.camera.fps
