"""Random scenes from one seed: room, cameras and people of a given density.

An example is `lab:random?seed=7&density=0.2`; `RandomScene` has the options.
"""

import math
from typing import Annotated, Literal
from urllib.parse import parse_qsl

import msgspec
import numpy as np
from msgspec import Meta

from common.config import Config
from lab.bodies.cast import cast_names
from lab.bodies.outfits import Outfit
from lab.camera.layouts import ROW_M, CameraModel, Clocks, Layout, Spacing, lay_out
from lab.camera.plan import CameraPlan, CameraSide, ImagePlan
from lab.depth.config import SensorName
from lab.furniture import FurniturePlan
from lab.motion.random_paths import FreeFloor, Position, random_plan, random_start
from lab.scenario import MAX_PEOPLE, WALKABLE_M, PersonPlan, RoomName, Scenario
from people4d.errors import ConfigError
from people4d.validation import explain

NAME = "random"
KEY = 0x5CE4E  # key of the random numbers
BESIDE_M = 0.45  # minimum distance of a stop from furniture [m]
CAMERA_M = 0.7  # minimum distance of a camera from furniture [m]
XTION_FOCAL = 0.835  # ratio of focal length to image width
CUT_M = 0.6  # minimum distance of people from a camera that is not avoided [m]

View = Literal["robot", "head", "ceiling", "any"]


class RandomScene(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Options of a random scene; the defaults resemble recordings of real people."""

    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    # [1/m2] people on the floor
    density: Annotated[float, Meta(ge=0.005, le=1.0)] = 0.15
    people: Annotated[int, Meta(ge=0, le=MAX_PEOPLE)] = 0  # number of people; 0: by density
    room: RoomName = "office"
    # robot: 1 to 1.2 m high; head: 1.5 to 1.8 m; ceiling: 2.2 m, tilted down and to a side
    view: View = "any"
    outfit: Literal["own", "dark", "random", "mixed"] = "mixed"  # mixed: half dark
    furniture: bool = True  # desks, chairs, partitions; not in the square
    plain: bool = False  # True: without the errors of a low-cost camera
    depth_sensor: SensorName = "xtion"
    duration_s: Annotated[float, Meta(ge=1, le=600)] = 15.0  # [s]
    fps: Annotated[float, Meta(ge=1, le=60)] = 10.0  # [Hz]
    width: CameraSide = 640  # [px]
    height: CameraSide = 480  # [px]
    # number of cameras; several: in the square, without furniture
    cameras: Annotated[int, Meta(ge=1, le=6)] = 1
    # ring: towards the centre; row: neighbours overlap slightly; apart: no overlap
    layout: Layout = "ring"
    row_m: Annotated[float, Meta(ge=1, le=6)] = ROW_M  # [m] distance of cameras in a row
    clocks: Clocks = "alike"  # free: each with its own offset, drift and rate
    robot: bool = False  # the last camera drives

    def __post_init__(self) -> None:
        """Check that a scene with a robot has a fixed camera."""
        super().__post_init__()
        if self.robot and self.cameras < 2:
            raise ValueError("robot: expected two cameras or more")


def is_random(name: str) -> bool:
    """Check for the name of a random scene."""
    return name == NAME or name.startswith(f"{NAME}?")


def read_options(name: str, seed: int | None = None) -> RandomScene:
    """Return the options in a name such as random?seed=7&density=0.2.

    Raises:
        ConfigError: One is unknown or out of range.
    """
    pairs = parse_qsl(name.partition("?")[2], keep_blank_values=True)
    values = dict(pairs) if seed is None else {**dict(pairs), "seed": str(seed)}
    try:
        return msgspec.convert(values, RandomScene, strict=False)
    except msgspec.ValidationError as error:
        fields = ", ".join(RandomScene.__struct_fields__)
        raise ConfigError(
            f"scenario {name}: {explain(error, values, '').lstrip('.: ')}", f"Options are {fields}."
        ) from error


def random_scenario(name: str, seed: int | None = None) -> Scenario:
    """Return the scene of a name and seed.

    Raises:
        ConfigError: An option is unknown or out of range, or the floor is too small for the people.
    """
    options = read_options(name, seed)
    rng = np.random.default_rng([options.seed, KEY])
    try:
        return (_several if options.cameras > 1 else _simulated)(options, rng)
    except ValueError as error:
        raise ConfigError(f"scenario {name}: {error}", "Try another seed or density.") from error


def _simulated(options: RandomScene, rng: np.random.Generator) -> Scenario:
    low, high = WALKABLE_M[options.room]
    camera = _camera(options, rng, (low[0] + 0.3, 0.0))
    furnished = options.furniture and options.room != "square"
    furniture = _furniture(rng, low, high, camera) if furnished else ()
    own = camera.at[0], camera.at[1]

    def is_free(position: Position) -> bool:
        clear = CUT_M if not camera.avoided else 1.0
        if math.dist(position, own) < clear:
            return False
        return not any(piece.holds(*position, BESIDE_M) for piece in furniture)

    floor = FreeFloor(low, high, is_free)
    count = options.people or max(1, round(options.density * floor.area_m2))
    people = _people(options, rng, floor, count)
    return Scenario(
        name=_name(options),
        about=f"Random scene: {count} people, {count / floor.area_m2:.2f} in a square metre.",
        duration_s=options.duration_s,
        seed=options.seed,
        room=options.room,
        camera=camera,
        furniture=furniture,
        people=people,
    )


def _several(options: RandomScene, rng: np.random.Generator) -> Scenario:
    model = CameraModel(
        width=options.width,
        height=options.height,
        focal_px=_focal_px(options),
        fps=options.fps,
        depth_sensor=options.depth_sensor,
        image=ImagePlan() if options.plain else _image(options, rng),
        duration_s=options.duration_s,
    )
    spaced = Spacing(options.layout, options.row_m)
    plan = lay_out(options.cameras, spaced, options.clocks, options.robot, model, rng)
    floor = FreeFloor(*plan.floor, lambda _: True)
    count = options.people or max(1, round(options.density * floor.area_m2))
    people = _people(options, rng, floor, count)
    return Scenario(
        name=_name(options),
        about=f"{options.cameras} cameras, {count} people.",
        duration_s=options.duration_s,
        seed=options.seed,
        room="square",
        camera=plan.cameras[0],
        cameras=plan.cameras[1:],
        people=people,
    )


def _people(
    options: RandomScene, rng: np.random.Generator, floor: FreeFloor, count: int
) -> tuple[PersonPlan, ...]:
    """Return people with random paths on a floor, each from a free start."""
    starts: list[Position] = []
    people = []
    for number in range(min(count, MAX_PEOPLE)):
        starts.append(random_start(rng, floor, starts))
        person = _person(options, rng, number, starts[-1])
        people.append(random_plan(rng, floor, starts[-1], person))
    return tuple(people)


def _person(
    options: RandomScene, rng: np.random.Generator, number: int, start: Position
) -> PersonPlan:
    names = cast_names()
    mixed: Outfit = "dark" if rng.random() < 0.5 else "random"
    return PersonPlan(
        body=names[int(rng.integers(len(names)))]
        if options.outfit != "own"
        else names[number % 12],
        outfit=mixed if options.outfit == "mixed" else options.outfit,
        size=float(np.clip(rng.normal(1.0, 0.03), 0.92, 1.08)),
        start=start,
    )


def _camera(options: RandomScene, rng: np.random.Generator, at: Position) -> CameraPlan:
    views: tuple[View, ...] = ("robot", "head", "ceiling")
    view = views[int(rng.integers(3))] if options.view == "any" else options.view
    heights = {"robot": (1.0, 1.2), "head": (1.5, 1.8), "ceiling": (2.15, 2.35)}[view]
    pitches = {"robot": (-2, 6), "head": (4, 14), "ceiling": (20, 30)}[view]
    rolls = {"robot": 1.0, "head": 3.0, "ceiling": 8.0}[view]
    image = _image(options, rng)
    return CameraPlan(
        at=(at[0], at[1] + float(rng.uniform(-0.6, 0.6)), float(rng.uniform(*heights))),
        yaw_deg=float(rng.uniform(-8, 8)),
        pitch_deg=float(rng.uniform(*pitches)),
        roll_deg=float(np.clip(rng.normal(0, rolls), -2 * rolls, 2 * rolls)),
        avoided=view == "robot",
        width=options.width,
        height=options.height,
        focal_px=_focal_px(options),
        fps=options.fps,
        exposure_s=0.0 if options.plain else float(rng.uniform(0.01, 0.04)),
        image=ImagePlan() if options.plain else image,
        depth_sensor=options.depth_sensor,
        depth_lag_s=0.0 if options.plain else float(rng.uniform(0, 0.03)),
    )


def _image(options: RandomScene, rng: np.random.Generator) -> ImagePlan:
    return ImagePlan(
        brightness=float(rng.uniform(0.7, 2.0)),
        exposure_stops=0.25,
        white_balance=0.06,
        grain=float(rng.uniform(1.0, 3.5)),
        blur_px=float(rng.uniform(0.3, 0.9)) * options.width / 640,
    )


def _focal_px(options: RandomScene) -> float:
    return options.width * (XTION_FOCAL if options.depth_sensor == "xtion" else 615 / 640)


def _furniture(
    rng: np.random.Generator, low: Position, high: Position, camera: CameraPlan
) -> tuple[FurniturePlan, ...]:
    """Return desks and chairs on both sides of an aisle, and a partition near the camera."""
    pieces = []
    aisle = rng.uniform(0.9, 1.3)
    for x in np.arange(low[0] + 2.0, high[0] - 0.6, 1.9):
        for side in (-1.0, 1.0):
            if rng.random() > 0.75:
                continue
            at = (float(x + rng.uniform(-0.2, 0.2)), float(side * (aisle + 0.45)))
            if abs(at[1]) + 0.4 > high[1]:
                continue
            yaw_deg = float(90 * side + rng.normal(0, 4))
            pieces.append(FurniturePlan(kind="desk", at=at, yaw_deg=yaw_deg))
            if rng.random() < 0.7:
                chair = (float(at[0] + rng.uniform(-0.4, 0.4)), float(at[1] - side * 0.55))
                turned = float(rng.uniform(-180, 180))
                pieces.append(FurniturePlan(kind="chair", at=chair, yaw_deg=turned))
    if rng.random() < 0.5:
        at = (float(low[0] + rng.uniform(2.0, 2.8)), float(rng.choice([-1, 1]) * 0.75))
        kind: Literal["partition", "cabinet"] = "partition" if rng.random() < 0.5 else "cabinet"
        pieces.append(FurniturePlan(kind=kind, at=at, yaw_deg=float(rng.normal(0, 10))))
    own = camera.at[:2]
    return tuple(piece for piece in pieces if not piece.holds(*own, CAMERA_M))


def _name(options: RandomScene) -> str:
    """Return the name of a scene's files: the options that differ from the default, except seed."""
    usual = msgspec.structs.asdict(RandomScene())
    values = msgspec.structs.asdict(options).items()
    changed = [f"{key}={value}" for key, value in values if key != "seed" and value != usual[key]]
    return "_".join([NAME, *changed])
