"""Random scenes from one seed: room, cameras and people of a given density."""

import math
from collections.abc import Iterator, Sequence
from typing import Literal, get_args

import numpy as np
from msgspec.structs import replace

from lab.bodies.cast import cast_names, child_names
from lab.bodies.outfits import Outfit
from lab.camera.layouts import lay_out
from lab.camera.plan import CameraPlan, ImagePlan
from lab.furniture import FurniturePlan, ObjectKind, ObjectPlan
from lab.motion.random_paths import FreeFloor, Position, random_plan, random_start
from lab.random_options import NAME, RandomScene, read_options
from lab.scenario import MAX_PEOPLE, WALKABLE_M, PersonPlan, Scenario
from people4d.errors import ConfigError

KEY, CHILD_KEY, OBJECT_KEY = 0x5CE4E, 0xC411D, 0x0B7EC  # keys of the random numbers
OBJECTS = get_args(ObjectKind)
CHILD_MPS = 0.8  # maximum speed of a child [m/s]
BESIDE_M = 0.45  # minimum distance of a stop from furniture [m]
CAMERA_M = 0.7  # minimum distance of a camera from furniture [m]
XTION_FOCAL = 0.835  # ratio of focal length to image width
CUT_M, AVOIDED_M = 0.6, 1.0  # minimum distances from a camera above people, and on a robot [m]
# Height [m], pitch [deg] and standard deviation of roll [deg] of each view
VIEWS: dict[str, tuple[tuple[float, float], tuple[float, float], float]] = {
    "robot": ((1.0, 1.2), (-2, 6), 1.0),
    "head": ((1.5, 1.8), (4, 14), 3.0),
    "ceiling": ((2.15, 2.35), (20, 30), 8.0),
}


def is_random(name: str) -> bool:
    """Check for the name of a random scene."""
    return name == NAME or name.startswith(f"{NAME}?")


def random_scenario(name: str, seed: int | None = None) -> Scenario:
    """Return the scene of a name and seed; ConfigError for bad options or a full floor."""
    options = read_options(name, seed)
    rng = np.random.default_rng([options.seed, KEY])
    try:
        return (_several if options.cameras > 1 else _single)(options, rng)
    except ValueError as error:
        raise ConfigError(f"scenario {name}: {error}", "Try another seed or density.") from error


def _single(options: RandomScene, rng: np.random.Generator) -> Scenario:
    low, high = WALKABLE_M[options.room]
    camera = _camera(options, rng, (low[0] + 0.3, 0.0))
    furnished = options.furniture and options.room != "square"
    furniture = _furniture(rng, low, high, camera) if furnished else ()
    own = camera.at[0], camera.at[1]

    def is_free(position: Position) -> bool:
        if math.dist(position, own) < (AVOIDED_M if camera.avoided else CUT_M):
            return False
        return not any(piece.holds(*position, BESIDE_M) for piece in furniture)

    floor = FreeFloor(low, high, is_free)
    objects = _objects(options, floor, camera)
    people = _people(options, rng, _around(floor, objects))
    count = len(people)
    return Scenario(
        name=options.name,
        about=f"Random scene: {count} people, {count / floor.area_m2:.2f} in a square metre.",
        duration_s=options.duration_s,
        seed=options.seed,
        room=options.room,
        camera=camera,
        furniture=furniture,
        objects=objects,
        people=people,
    )


def _several(options: RandomScene, rng: np.random.Generator) -> Scenario:
    cameras, floor = lay_out(options, _model(options, rng), rng)
    free = FreeFloor(*floor, lambda _: True)
    objects = _objects(options, free, cameras[0])
    people = _people(options, rng, _around(free, objects))
    return Scenario(
        name=options.name,
        about=f"{options.cameras} cameras, {len(people)} people.",
        duration_s=options.duration_s,
        seed=options.seed,
        room="square",
        camera=cameras[0],
        cameras=cameras[1:],
        objects=objects,
        people=people,
    )


def _objects(options: RandomScene, floor: FreeFloor, camera: CameraPlan) -> tuple[ObjectPlan, ...]:
    """Return objects on free floor at a distance from each other, which face a camera roughly."""
    rng = np.random.default_rng([options.seed, OBJECT_KEY])
    objects: list[ObjectPlan] = []
    for _ in range(options.objects):
        at = _around(floor, objects).position(rng)
        to_camera = math.atan2(camera.at[1] - at[1], camera.at[0] - at[0])
        kind: ObjectKind = OBJECTS[int(rng.integers(len(OBJECTS)))]
        objects.append(
            ObjectPlan(
                kind=kind,
                at=at,
                yaw_deg=math.degrees(to_camera) + float(rng.uniform(-40, 40)),
                body=str(rng.choice(cast_names())),
            )
        )
    return tuple(objects)


def _around(floor: FreeFloor, objects: Sequence[ObjectPlan]) -> FreeFloor:
    """Return the floor without objects and their surroundings."""

    def is_free(position: Position) -> bool:
        near = any(thing.holds(*position, BESIDE_M) for thing in objects)
        return not near and floor.is_free(position)

    return FreeFloor(floor.low_m, floor.high_m, is_free)


def _people(
    options: RandomScene, rng: np.random.Generator, floor: FreeFloor
) -> tuple[PersonPlan, ...]:
    """Return people with random paths on a floor, each from a free start."""
    count = options.people or max(1, round(options.density * floor.area_m2))
    starts: list[Position] = []
    people = []
    for number in range(min(count, MAX_PEOPLE)):
        starts.append(random_start(rng, floor, starts))
        person = _person(options, rng, number, starts[-1])
        people.append(random_plan(rng, floor, person))
    return tuple(_varied(options, people))


def _varied(options: RandomScene, people: list[PersonPlan]) -> Iterator[PersonPlan]:
    """Yield people, the first of them as children and the next in wheelchairs."""
    rng = np.random.default_rng([options.seed, CHILD_KEY])
    for number, person in enumerate(people):
        if number < options.children:
            body, speed_mps = str(rng.choice(child_names())), min(person.speed_mps, CHILD_MPS)
            yield replace(person, body=body, outfit="own", speed_mps=speed_mps)
        else:
            yield replace(person, wheelchair=number < options.children + options.wheelchairs)


def _person(
    options: RandomScene, rng: np.random.Generator, number: int, start: Position
) -> PersonPlan:
    names = cast_names()
    mixed: Outfit = "dark" if rng.random() < 0.5 else "random"
    own = options.outfit == "own"
    return PersonPlan(
        body=names[number % 12] if own else names[int(rng.integers(len(names)))],
        outfit=mixed if options.outfit == "mixed" else options.outfit,
        size=float(np.clip(rng.normal(1.0, 0.03), 0.92, 1.08)),
        start=start,
    )


def _camera(options: RandomScene, rng: np.random.Generator, at: Position) -> CameraPlan:
    drawn = list(VIEWS)[int(rng.integers(3))] if options.view == "any" else options.view
    heights, pitches, roll = VIEWS[drawn]
    image = _image(options, rng)
    return CameraPlan(
        at=(at[0], at[1] + float(rng.uniform(-0.6, 0.6)), float(rng.uniform(*heights))),
        yaw_deg=float(rng.uniform(-8, 8)),
        pitch_deg=float(rng.uniform(*pitches)),
        roll_deg=float(np.clip(rng.normal(0, roll), -2 * roll, 2 * roll)),
        avoided=drawn == "robot",
        width=options.width,
        height=options.height,
        focal_px=_focal_px(options),
        fps=options.fps,
        exposure_s=0.0 if options.plain else float(rng.uniform(0.01, 0.04)),
        image=ImagePlan() if options.plain else image,
        depth_sensor=options.depth_sensor,
        depth_lag_s=0.0 if options.plain else float(rng.uniform(0, 0.03)),
    )


def _model(options: RandomScene, rng: np.random.Generator) -> CameraPlan:
    """Return image and rate of each of several cameras."""
    return CameraPlan(
        avoided=False,
        width=options.width,
        height=options.height,
        focal_px=_focal_px(options),
        fps=options.fps,
        depth_sensor=options.depth_sensor,
        image=ImagePlan() if options.plain else _image(options, rng),
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
