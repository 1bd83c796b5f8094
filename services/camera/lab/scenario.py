"""Scenarios: who walks where, seen by which camera, in which room; text files anyone can add."""

import math
import re
import tomllib
from pathlib import Path
from typing import Literal

import msgspec

from common.errors import ConfigError

FOLDER = Path(__file__).parent / "scenarios"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


class Waypoint(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A place on a person's way."""

    to: tuple[float, float]  # [m] x, y, frame: map
    speed_mps: float | None = None  # [m/s] on the way there; None: the person's own
    stop_s: float = 0.0  # [s] to stay there; 0: walk on without stopping
    face_deg: float | None = None  # [deg] to face while there, 0 = +x; None: as arrived
    sit: bool = False  # sit down while there (on a stool, which the scenario places there)
    look_around: bool = False  # turn the head while there


class PersonPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One person and their way."""

    body: str  # name in the cast, see `people4d lab list`
    start: tuple[float, float]  # [m] x, y, frame: map
    face_deg: float = 180.0  # [deg] faced at the start, 0 = +x
    speed_mps: float = 1.0  # [m/s] of free walking, 0.4 to 1.4
    wait_s: float = 0.0  # [s] to stand before the first step
    path: tuple[Waypoint, ...] = ()  # in order; empty: stands all the time
    repeat: bool = False  # begin the path anew at its end


class Drive(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A stretch of the robot's way; speed and turn change smoothly from one to the next."""

    for_s: float  # [s]
    speed_mps: float = 0.0  # [m/s] forward
    turn_dps: float = 0.0  # [deg/s] counter-clockwise


class WheelPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The wheel encoders of the robot."""

    rate_hz: float = 50.0  # [Hz]
    radius_m: float = 0.0325  # [m] of each wheel
    track_m: float = 0.30  # [m] between the wheels
    ticks_per_turn: int = 4096  # of a wheel
    scale_error: float = 0.01  # relative error of the radius, both wheels alike
    track_error: float = (
        0.01  # relative error of the wheel track: turns come out too small or large
    )
    slip: float = 0.02  # standard deviation of each wheel's relative slip, drawn anew every second


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


class CapturePlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The motion-capture system."""

    rate_hz: float = 100.0  # [Hz]
    noise_m: float = 0.0  # [m] standard deviation of positions, white
    yaw_noise_deg: float = 0.0  # [deg] standard deviation of yaw, white
    dropout: float = 0.0  # share of time a person is not captured, in gaps of `dropout_s`
    dropout_s: float = 0.5  # [s] mean length of a gap
    clock_offset_s: float = 0.0  # [s] its clock minus the camera's


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
        """Check numbers.

        Raises:
            ValueError: A value is out of range.
        """
        if not 0 < self.duration_s <= 3600:
            raise ValueError(f"duration_s: expected up to 3600, got {self.duration_s}")
        if not 1 <= self.camera.fps <= 120 or self.camera.focal_px <= 0:
            raise ValueError(f"camera.fps: expected 1 to 120, got {self.camera.fps}")
        for person in self.people:
            for speed in (person.speed_mps, *(w.speed_mps for w in person.path)):
                if speed is not None and not 0.4 <= speed <= 1.4:
                    raise ValueError(f"speed_mps: expected 0.4 to 1.4, got {speed}")
            if not all(
                map(math.isfinite, [*person.start, *(v for w in person.path for v in w.to)])
            ):
                raise ValueError("start, to: expected finite numbers")


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
    except (OSError, ValueError) as error:
        raise ConfigError(f"scenario {path}: {error}") from error


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
