"""Plans of people who go about in a room, drawn at random."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lab.scenario import APART_M, PersonPlan, Waypoint

Position = tuple[float, float]
SPEED_MPS, SPEED_SIGMA_MPS = 0.95, 0.2  # of free walking indoors
POSITIONS = 24  # of a path that is repeated
STOPS = 0.3  # share of positions at which people stay
STOP_S = (0.5, 5.0)
NEAR_M = 3.0  # the next position is about as near for some, anywhere for others
NEAR = 0.5  # share of people who stay near
TRIES = 2000


@dataclass(frozen=True)
class FreeFloor:
    """Floor on which people go about."""

    low_m: Position  # lower corner, frame: map
    high_m: Position  # upper corner
    is_free: Callable[[Position], bool]  # False: furniture is there

    @property
    def area_m2(self) -> float:
        """Area between the corners."""
        return (self.high_m[0] - self.low_m[0]) * (self.high_m[1] - self.low_m[1])

    def position(self, rng: np.random.Generator) -> Position:
        """Return a free position.

        Raises:
            ValueError: None is free.
        """
        for _ in range(TRIES):
            x, y = rng.uniform(self.low_m, self.high_m).tolist()
            if self.is_free((x, y)):
                return round(x, 3), round(y, 3)
        raise ValueError("no free floor: expected fewer pieces of furniture")


def random_start(rng: np.random.Generator, floor: FreeFloor, others: list[Position]) -> Position:
    """Return a free position apart from others.

    Raises:
        ValueError: None is free.
    """
    for _ in range(TRIES):
        start = floor.position(rng)
        if all(math.dist(start, other) >= APART_M + 0.05 for other in others):
            return start
    raise ValueError(f"density: expected room for {len(others) + 1} people")


def random_plan(
    rng: np.random.Generator, floor: FreeFloor, start: Position, plan: PersonPlan
) -> PersonPlan:
    """Return the plan of a person who walks from position to position and stops at some.

    Args:
        rng: Random numbers.
        floor: Where they walk.
        start: First position.
        plan: Body and clothes.
    """
    stays_near = rng.random() < NEAR
    path, here = [], start
    for _ in range(POSITIONS):
        there = _next(rng, floor, here, NEAR_M if stays_near else math.inf)
        stops = rng.random() < STOPS
        path.append(
            Waypoint(
                to=there,
                stop_s=float(rng.uniform(*STOP_S)) if stops else 0.0,
                face_deg=float(rng.uniform(-180, 180)) if stops else None,
                turn_head=bool(stops and rng.random() < 0.3),
            )
        )
        here = there
    return PersonPlan(
        body=plan.body,
        outfit=plan.outfit,
        size=plan.size,
        start=start,
        face_deg=float(rng.uniform(-180, 180)),
        speed_mps=float(np.clip(rng.normal(SPEED_MPS, SPEED_SIGMA_MPS), 0.5, 1.35)),
        wait_s=float(rng.uniform(0, 2)) if rng.random() < STOPS else 0.0,
        path=tuple(path),
        repeat=True,
    )


def _next(rng: np.random.Generator, floor: FreeFloor, here: Position, near_m: float) -> Position:
    """Return a free position at least a few steps away, within a distance if there is one."""
    there = here
    for _ in range(20):
        there = floor.position(rng)
        if 1.2 < math.dist(here, there) < near_m:
            break
    return there
