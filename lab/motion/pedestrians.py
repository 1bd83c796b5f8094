"""Recorded paths of pedestrians, cut to what happens before a camera.

Read are files `obsmat.txt` of the data sets ETH [Pellegrini 2009] and UCY [Lerner 2007] as the
toolkit OpenTraj distributes them: frame, person, x, z, y, and velocities, in metres.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from people4d.errors import ConfigError
from people4d.messages import F64

FILE = "obsmat.txt"
COLUMNS = 8
SAMPLE_S = 0.4  # between two samples of a path
# Outdoors people walk 1.3 m/s and more, the lab's at most 1.4: time passes so much more slowly.
SLOWER = 0.75
BEFORE_S = 20.0  # that paths go on straight before their first sample, and after their last
SEARCHED = 300  # scenes among which that of the wanted density is chosen
STEP_S = 0.5  # at which people are counted


@dataclass(frozen=True)
class FloorView:
    """Floor that a camera sees: a sector."""

    reach_m: float  # radius
    angle_rad: float  # between its sides

    @property
    def area_m2(self) -> float:
        """Area of the sector."""
        return self.reach_m**2 * self.angle_rad / 2

    def holds(self, positions_m: F64) -> F64:
        """Return 1 for Nx2 positions inside, camera at the origin that faces +x; else 0."""
        x, y = positions_m.T
        inside = np.abs(np.arctan2(y, x)) < self.angle_rad / 2
        return np.asarray(inside & (np.hypot(x, y) < self.reach_m), np.float64)


@dataclass(frozen=True)
class PedestrianScene:
    """Paths before a camera at the origin that faces +x."""

    paths: tuple[F64, ...]  # Nx3 each: time in s, x and y in m
    density: float  # mean number of people in a square metre of the floor in view


def read_pedestrians(path: Path) -> list[F64]:
    """Return the paths in a file or folder: Nx3 each, time in s, x and y in m.

    Raises:
        ConfigError: It cannot be read, or is no such file.
    """
    file = path / FILE if path.is_dir() else path
    try:
        rows = np.loadtxt(file, ndmin=2)
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"paths of pedestrians {file} cannot be read: {error}",
            f"Give a folder with {FILE} of ETH or UCY: frame, person, x, z, y, and velocities.",
        ) from error
    if rows.shape[1] != COLUMNS or not np.isfinite(rows).all():
        raise ConfigError(f"{file}: expected {COLUMNS} finite columns, got {rows.shape[1]}")
    frames = np.unique(rows[:, 0])
    frame_s = SAMPLE_S / SLOWER / float(np.median(np.diff(frames)) if len(frames) > 1 else 1)
    paths = []
    for person in np.unique(rows[:, 1]):
        own = rows[rows[:, 1] == person]
        own = own[np.unique(own[:, 0], return_index=True)[1]]
        if len(own) > 1:
            path_m = np.column_stack([own[:, 0] * frame_s, own[:, 2], own[:, 4]])
            paths.append(_extended(path_m))
    if not paths:
        raise ConfigError(f"{file}: expected the path of at least one person")
    return paths


def choose_scene(
    paths: list[F64], view: FloorView, density: float, duration_s: float, seed: int
) -> PedestrianScene:
    """Return the scene whose density comes nearest to a wanted one, of many drawn at random.

    Args:
        paths: See `read_pedestrians`.
        view: Floor that the camera sees.
        density: People in a square metre of it.
        duration_s: Of the scene.
        seed: Of the choice.
    """
    rng = np.random.default_rng([seed, 0x9ED])
    points = np.concatenate(paths)
    scenes = [_scene(paths, points, duration_s, rng) for _ in range(SEARCHED)]
    scored = [(abs(_density(s, view, duration_s) - density), k) for k, s in enumerate(scenes)]
    best = scenes[min(scored)[1]]
    return PedestrianScene(tuple(best), _density(best, view, duration_s))


def _scene(paths: list[F64], points: F64, duration_s: float, rng: np.random.Generator) -> list[F64]:
    """Return paths before a camera that looks at a random sample of them."""
    begin_s, x, y = points[int(rng.integers(len(points)))]
    begin_s -= rng.uniform(0, duration_s)
    yaw, ahead_m = rng.uniform(-math.pi, math.pi), rng.uniform(1.5, 4.0)
    cos, sin = math.cos(yaw), math.sin(yaw)
    camera = np.array([x - ahead_m * cos, y - ahead_m * sin])
    scene = []
    for path in paths:
        if path[-1, 0] < begin_s - 2 or path[0, 0] > begin_s + duration_s + 4:
            continue
        offset = path[:, 1:] - camera
        moved = np.column_stack(
            [
                path[:, 0] - begin_s,
                cos * offset[:, 0] + sin * offset[:, 1],
                cos * offset[:, 1] - sin * offset[:, 0],
            ]
        )
        scene.append(moved)
    return scene


def _density(scene: list[F64], view: FloorView, duration_s: float) -> float:
    times_s = np.arange(0.0, duration_s, STEP_S)
    counts = np.zeros(len(times_s))
    for path in scene:
        positions = np.column_stack([np.interp(times_s, path[:, 0], path[:, k]) for k in (1, 2)])
        counts += view.holds(positions)
    return float(counts.mean()) / view.area_m2


def _extended(path: F64) -> F64:
    """Let a path begin earlier and end later, straight on."""
    first, last = (_velocity(path[:4]), _velocity(path[-4:]))
    seconds = np.arange(1.0, BEFORE_S + 1)[:, None]
    before = (path[0] - np.hstack([seconds, seconds * first]))[::-1]
    after = path[-1] + np.hstack([seconds, seconds * last])
    return np.vstack([before, path, after])


def _velocity(part: F64) -> F64:
    return np.asarray((part[-1, 1:] - part[0, 1:]) / (part[-1, 0] - part[0, 0]))
