"""Random plans of people in a room."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from lab.scenario import APART_M, PersonPlan, Waypoint

Position = tuple[float, float]
SPEED_MPS, SPEED_SIGMA_MPS = 0.95, 0.2  # mean and standard deviation of indoor walking [m/s]
POSITIONS = 24  # number of positions of a repeated path
STOPS = 0.3  # share of positions with a stop
STOP_S = (0.5, 5.0)  # minimum and maximum duration of a stop [s]
STEP_M, NEAR_M = 1.2, 3.0  # minimum step of a path, and maximum step of local paths [m]
NEAR = 0.5  # share of people with local paths
TRIES = 2000  # maximum number of drawn positions


@dataclass(frozen=True)
class FreeFloor:
    """Floor on which people walk."""

    low_m: Position  # lower corner, frame: map
    high_m: Position  # upper corner
    is_free: Callable[[Position], bool]  # returns False too near furniture or a camera

    @property
    def area_m2(self) -> float:
        """Area between the corners."""
        return (self.high_m[0] - self.low_m[0]) * (self.high_m[1] - self.low_m[1])

    def position(self, rng: np.random.Generator) -> Position:
        """Return a free position; ValueError if no position is free."""
        for _ in range(TRIES):
            x, y = rng.uniform(self.low_m, self.high_m).tolist()
            if self.is_free((x, y)):
                return round(x, 3), round(y, 3)
        raise ValueError("no free floor: expected fewer pieces of furniture")


def random_start(rng: np.random.Generator, floor: FreeFloor, others: list[Position]) -> Position:
    """Return a free position at a distance from others; ValueError if no position is free."""
    for _ in range(TRIES):
        start = floor.position(rng)
        if all(math.dist(start, other) >= APART_M + 0.05 for other in others):
            return start
    raise ValueError(f"density: expected room for {len(others) + 1} people")


def random_plan(rng: np.random.Generator, floor: FreeFloor, person: PersonPlan) -> PersonPlan:
    """Return the plan of a person with a random path over the floor, with stops."""
    far_m = NEAR_M if rng.random() < NEAR else math.inf
    path, here = [], person.start
    for _ in range(POSITIONS):
        here = _next_position(rng, floor, here, far_m)
        stops = rng.random() < STOPS
        path.append(
            Waypoint(
                to=here,
                stop_s=float(rng.uniform(*STOP_S)) if stops else 0.0,
                face_deg=float(rng.uniform(-180, 180)) if stops else None,
                turn_head=bool(stops and rng.random() < 0.3),
            )
        )
    return replace(
        person,
        face_deg=float(rng.uniform(-180, 180)),
        speed_mps=float(np.clip(rng.normal(SPEED_MPS, SPEED_SIGMA_MPS), 0.5, 1.35)),
        wait_s=float(rng.uniform(0, 2)) if rng.random() < STOPS else 0.0,
        path=tuple(path),
        repeat=True,
    )


def _next_position(
    rng: np.random.Generator, floor: FreeFloor, here: Position, far_m: float
) -> Position:
    """Return a free position, if possible farther than STEP_M and within `far_m`."""
    there = here
    for _ in range(20):
        there = floor.position(rng)
        if STEP_M < math.dist(here, there) < far_m:
            break
    return there
