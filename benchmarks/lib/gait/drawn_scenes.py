"""Scenes of the other simulator for the test split of `benchmarks.ablation`, drawn from seeds."""

import colorsys
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.lib.gait.other_walkers import Drive, Scene, Style, Walk, Wave, Waypoint
from people4d.messages import F64

SECONDS = 10.0
CHECK_S = 0.1  # interval at which distances are checked
STEP_S = 0.05  # maximum step of a walk that is checked
APART_M = 0.5  # minimum distance between people
CAMERA_APART_M = 1.2  # minimum distance to a moving camera
TRIES = 60  # number of drawn paths of one person before the scene is drawn again
CONE = 0.45  # half width of the drawn area by distance, within the field of view of 0.52
CAMERA_X_M = -0.3
WALKERS = 3  # Number of people on paths through the entire view; other people stay in one area
STAY_M = 0.6
ALIKE = 3  # Number of people in the same clothes
SPEED_MPS = (0.6, 1.25)


@dataclass(frozen=True)
class SceneKind:
    """Common rules of the scenes of one kind."""

    people: tuple[int, int]  # minimum and maximum number of people
    moves: bool = False  # True: the camera moves
    alike: bool = False  # True: some people wear the same clothes
    leave: bool = False  # True: some people leave the view and return


KINDS = {
    "standing": SceneKind((3, 4)),
    "moving": SceneKind((3, 4), moves=True),
    "alike": SceneKind((3, 5), alike=True),
    "leaving": SceneKind((3, 4), leave=True),
    "crowd": SceneKind((5, 6)),
    "moving_alike": SceneKind((3, 5), moves=True, alike=True, leave=True),
}
SEEDS = range(7100, 7136)  # seeds fixed before the first run; no constant is tuned on these scenes


def drawn_scenes() -> Iterator[tuple[str, int]]:
    """Yield name and seed of each scene, one kind after the other."""
    for k, seed in enumerate(SEEDS):
        yield f"{list(KINDS)[k % len(KINDS)]}_{seed}", seed


def draw_scene(name: str) -> Scene:
    """Return the scene of a name, `KIND_SEED`."""
    kind, _, seed = name.rpartition("_")
    rng = np.random.default_rng(int(seed))
    rule = KINDS[kind]
    count = int(rng.integers(rule.people[0], rule.people[1] + 1))
    scene = Scene(
        people=(),
        seconds=SECONDS,
        fps=float(rng.choice((10.0, 10.0, 12.5))),
        height_m=float(rng.uniform(0.8, 1.6)),
        drive=_drive(rng) if rule.moves else None,
        width_m=5.0 if rule.leave or rule.moves else float(rng.choice((3.5, 5.0))),
        exposure=float(rng.uniform(0.6, 1.15)),
        halved=True,
    )
    styles = _styles(rng, count, rule.alike)
    while True:
        people = _people(rng, scene, styles, rule.leave)
        if len(people) == count:
            return replace(scene, people=people)


def _drive(rng: np.random.Generator) -> Drive:
    def wave(amplitude: tuple[float, float], rate: tuple[float, float]) -> Wave:
        low, high = np.array((amplitude, rate, (0.0, math.tau))).T
        first, second, third = rng.uniform(low, high).tolist()
        return first, second, third

    distance, turn = rng.normal(1.0, (0.02, 0.015)).tolist()
    x, y = wave((0.1, 0.25), (0.2, 0.6)), wave((0.1, 0.4), (0.2, 0.6))
    return Drive(x, y, wave((0.2, 0.5), (0.4, 1.2)), (distance, turn))


def _styles(rng: np.random.Generator, count: int, alike: bool) -> list[Style]:
    """Return people of several bodies, sizes and clothes, without paths."""
    bodies = [*rng.permutation(list("abcde")), *rng.choice(list("abcde"), 1)]
    styles = list[Style]()
    for body in bodies[:count]:
        clothes = {
            "shirt": _colour(rng),
            "trousers": _colour(rng, 0.45),
            "pattern": int(rng.integers(0, 5)),
            "sleeve": str(rng.choice(("short", "long"))),
        }
        size = tuple(float(s) for s in rng.uniform((0.95, 0.93), (1.05, 1.04)))
        style = Style(
            body=str(body),
            path=(),
            speed_mps=float(rng.uniform(*SPEED_MPS)),
            stride=float(rng.uniform(0.85, 1.1)),
            arms=str(rng.choice(("swing", "swing", "swing", "pockets", "carry"))),
            size=(size[0], size[1]),
            clothes=clothes,
        )
        same = alike and 0 < len(styles) < ALIKE
        styles.append(replace(style, clothes=styles[0].clothes) if same else style)
    return styles


def _colour(rng: np.random.Generator, value: float = 0.85) -> F64:
    """Return a linear colour of clothes, of a maximum brightness."""
    hue, saturation = float(rng.random()), float(rng.uniform(0.0, 0.7))
    return np.array(colorsys.hsv_to_rgb(hue, saturation, rng.uniform(0.12, value))) ** 2.2


def _people(
    rng: np.random.Generator, scene: Scene, styles: Sequence[Style], leave: bool
) -> tuple[Style, ...]:
    """Return people on paths at a distance from each other; fewer if no path is found."""
    times_s = np.arange(1, scene.seconds / CHECK_S) * CHECK_S
    camera = scene.drive.poses(times_s)[:, :2] if scene.drive else np.zeros((len(times_s), 2))
    optical_m = camera + np.array((CAMERA_X_M, 0.0))
    taken, people = [(optical_m, CAMERA_APART_M)], list[Style]()
    for k, style in enumerate(styles):
        for _ in range(TRIES):
            path = _path(rng, scene.width_m, leaves=leave and k < 2, stays=k >= WALKERS)
            walker = replace(style, path=path)
            gone_m = _positions(walker, taken)
            if gone_m is not None:
                taken.append((gone_m, APART_M))
                people.append(walker)
                break
    return tuple(people)


def _path(
    rng: np.random.Generator, width_m: float, *, leaves: bool, stays: bool
) -> tuple[Waypoint, ...]:
    """Return waypoints in view, some with stops; the third is outside the view if `leaves`.

    If `stays`, all waypoints are near the first one.
    """
    points = list[Waypoint]()
    for k in range(8):
        x_m = float(rng.uniform(1.7, 4.6))
        if stays and k:
            x_m = float(np.clip(points[0][0] + rng.uniform(-STAY_M, STAY_M), 1.7, 4.6))
        side_m = min(CONE * (x_m - CAMERA_X_M), width_m / 2 - 0.45)
        y_m = float(rng.uniform(-side_m, side_m))
        if stays and k:
            y_m = float(np.clip(points[0][1] + rng.uniform(-STAY_M, STAY_M), -side_m, side_m))
        if leaves and k == 2:
            x_m = float(rng.uniform(1.2, 2.2))
            beside_m = min(0.52 * (x_m - CAMERA_X_M) + 0.7, width_m / 2 - 0.35)
            points.append((x_m, float(rng.choice((-1, 1))) * beside_m, 2.2, math.pi))
        elif rng.random() < (0.7 if stays else 0.3):
            points.append((x_m, y_m, float(rng.uniform(0.8, 3.0)), float(rng.uniform(-3.1, 3.1))))
        else:
            points.append((x_m, y_m))
    return tuple(points)


def _positions(style: Style, taken: Sequence[tuple[F64, float]]) -> F64 | None:
    """Return the positions of a person on the ground (Nx2); None if another person is near."""
    walk, found = Walk(style), list[tuple[float, float]]()
    for k in range(len(taken[0][0])):
        walk.advance(CHECK_S, STEP_S)
        at = walk.x_m, walk.y_m
        if any(math.dist(at, other[k]) < far for other, far in taken):
            return None
        found.append(at)
    return np.array(found)
