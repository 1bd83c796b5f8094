"""Collision avoidance of walkers.

Each walker selects, ten times a second, the heading and speed of minimum cost. Candidates are
extrapolated with the present velocities of the others; the cost grows with the detour and with
small distances (after the choice of heading in [Moussaïd 2011]).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lab.motion.walker import Walker
from people4d.messages import F64

PositionFunction = Callable[[float], F64]
Disc = tuple[float, float, float]  # [m] x, y and radius, frame: map

DECIDE_EVERY = 10  # interval between decisions [steps of the simulation]
HORIZON_S = 3.0  # duration of the extrapolation [s]
COMFORT_M = 0.95  # distance of centres below which walkers deviate [m]
PERSONAL_M = 0.62  # distance of centres below which walkers stop [m]
ROBOT_EXTRA_M = 0.15  # additional distance from a robot [m]
STANDING_RADIUS_M = 0.38  # radius of an obstacle that is passed at the distance of a person [m]
STOOL_LESS_M, OWN_STOOL_LESS_M = 0.2, 0.35  # reduction of the distance from stools, own stool [m]

# Candidates: directions relative to the goal [rad], and shares of the free speed
_OFFSETS = np.radians([0, 8, -8, 16, -16, 26, -26, 38, -38, 52, -52, 70, -70, 90, -90, 115, -115])
_SHARES = np.array([1.0, 0.8, 0.55, 0.3, 0.0])
OFFSETS, SHARES = (grid.ravel() for grid in np.meshgrid(_OFFSETS, _SHARES, indexing="ij"))
# A small additional cost of the left makes head-on walkers both pass on the right.
DETOUR_COST = (1.0 - np.cos(OFFSETS)) + 0.02 * (OFFSETS > 0) + 0.9 * (1.0 - SHARES) ** 2
NEAR_COST, PERSONAL_COST, BOUND_COST, CHANGE_COST = 2.5, 6.0, 4.0, 0.15


@dataclass(frozen=True)
class CrowdPaths:
    """Paths of all people; arrays are NxT in steps of STEP_S."""

    times_s: F64  # T
    x_m: F64  # frame: map; with y_m
    y_m: F64
    yaw_rad: F64  # not wrapped
    seated: F64  # 0 standing to 1 seated
    looking: F64  # 1 while looking around


@dataclass(frozen=True)
class Surroundings:
    """Free area, stools and robot around the walkers."""

    bounds_m: F64  # 2x2, lower and upper corner of the free floor, frame: map
    stools_m: Sequence[tuple[float, float]] = ()  # positions of stools, x and y, frame: map
    # position of a moving obstacle, such as a robot, at a time: x, y and optionally more
    obstacle: PositionFunction | None = None
    discs: Sequence[Disc] = ()  # static obstacles


@dataclass(frozen=True)
class Obstacles:
    """Obstacles of one person: M positions with velocities and extra distances."""

    position_m: F64
    velocity_mps: F64
    extra_m: F64


def simulate_paths(walkers: Sequence[Walker], times_s: F64, around: Surroundings) -> CrowdPaths:
    """Simulate N walkers over T steps of STEP_S; the walkers are changed in place."""
    record = np.empty((5, len(walkers), len(times_s)))
    choices = [(walker.yaw_rad, 0.0) for walker in walkers]
    robot: tuple[F64, F64] | None = None
    for step, time_s in enumerate(times_s.tolist()):
        for walker in walkers:
            walker.decide(time_s)
        if step % DECIDE_EVERY == 0:
            robot = None if around.obstacle is None else _moving(around.obstacle, time_s)
            choices = [
                _choose(walker, _obstacles(walkers, i, around, robot), around.bounds_m, choices[i])
                for i, walker in enumerate(walkers)
            ]
        for i, walker in enumerate(walkers):
            heading, speed = choices[i]
            if walker.goal_m is None:
                heading, speed = walker.bearing_rad(), 0.0
            walker.move(heading, min(speed, _safe_speed(walker, walkers, robot)))
            pose = walker.x_m, walker.y_m, walker.yaw_rad
            record[:, i, step] = (*pose, walker.seated, walker.looking)
    x, y, yaw, seated, looking = record
    return CrowdPaths(times_s, x, y, yaw, seated, looking)


def _moving(position: PositionFunction, time_s: float) -> tuple[F64, F64]:
    before, now = position(time_s - 0.1)[:2], position(time_s)[:2]
    return now, (now - before) / 0.1


def _obstacles(
    walkers: Sequence[Walker], me: int, around: Surroundings, robot: tuple[F64, F64] | None
) -> Obstacles:
    rows = []
    for i, other in enumerate(walkers):
        if i != me:
            cos, sin = math.cos(other.yaw_rad), math.sin(other.yaw_rad)
            rows.append((other.x_m, other.y_m, other.speed_mps * cos, other.speed_mps * sin, 0.0))
    for stool in around.stools_m:
        less_m = OWN_STOOL_LESS_M if stool == walkers[me].stool_m else STOOL_LESS_M
        rows.append((*stool, 0.0, 0.0, -less_m))
    rows += [(x, y, 0.0, 0.0, radius - STANDING_RADIUS_M) for x, y, radius in around.discs]
    if robot is not None:
        rows.append((*robot[0].tolist(), *robot[1].tolist(), ROBOT_EXTRA_M))
    table = np.array(rows).reshape(-1, 5)
    return Obstacles(table[:, :2], table[:, 2:4], table[:, 4])


def _choose(
    walker: Walker, around: Obstacles, bounds_m: F64, last: tuple[float, float]
) -> tuple[float, float]:
    if walker.goal_m is None:
        return walker.bearing_rad(), 0.0
    headings = walker.bearing_rad() + OFFSETS
    speeds = walker.cruise_mps * SHARES
    velocities = np.stack([speeds * np.cos(headings), speeds * np.sin(headings)], axis=-1)
    here = np.array([walker.x_m, walker.y_m])
    cost = DETOUR_COST + CHANGE_COST * (1 - np.cos(headings - last[0]))
    if len(around.position_m):
        # Distances beyond the goal do not count.
        horizon_s = min(HORIZON_S, walker.goal_distance_m() / walker.cruise_mps + 0.5)
        cost = cost + _nearness(here, velocities, around, horizon_s)
    ahead = here + velocities * 0.8
    outside = np.maximum(bounds_m[0] - ahead, 0.0) + np.maximum(ahead - bounds_m[1], 0.0)
    cost = cost + BOUND_COST * outside.sum(axis=-1)
    best = int(np.argmin(cost))
    return float(headings[best]), float(speeds[best])


def _nearness(here: F64, velocities: F64, around: Obstacles, horizon_s: float) -> F64:
    """Return the cost of small distances to obstacles, for C velocities (Cx2)."""
    offset = around.position_m - here  # Mx2
    relative = around.velocity_mps - velocities[:, None]  # CxMx2
    closing = -np.sum(relative * offset, axis=-1)
    when_s = np.clip(closing / np.maximum(np.sum(relative**2, axis=-1), 1e-9), 0.0, horizon_s)
    nearest = np.linalg.norm(offset + relative * when_s[..., None], axis=-1) - around.extra_m
    urgency = 1.0 / (0.5 + when_s)
    comfort = np.maximum(COMFORT_M - nearest, 0.0) / COMFORT_M
    personal = np.maximum(PERSONAL_M - nearest, 0.0) / PERSONAL_M
    # Moving away from an obstacle that is already near has no cost.
    leaving = (when_s == 0.0) & (closing < 0.0)
    cost = (NEAR_COST * comfort**2 + PERSONAL_COST * personal) * urgency
    return np.asarray(np.where(leaving, 0.0, cost).sum(axis=-1))


def _safe_speed(walker: Walker, walkers: Sequence[Walker], robot: tuple[F64, F64] | None) -> float:
    """Return the maximum speed at which a walker can stop in front of an obstacle ahead."""
    obstacles = [(other.x_m, other.y_m, PERSONAL_M) for other in walkers if other is not walker]
    if robot is not None:
        obstacles.append((*robot[0].tolist(), PERSONAL_M + ROBOT_EXTRA_M))
    ahead_x, ahead_y = math.cos(walker.yaw_rad), math.sin(walker.yaw_rad)
    safe = math.inf
    for x, y, clearance in obstacles:
        away_x, away_y = x - walker.x_m, y - walker.y_m
        distance = math.hypot(away_x, away_y)
        if distance < 1.5 and away_x * ahead_x + away_y * ahead_y > 0.5 * distance:
            safe = min(safe, math.sqrt(2.0 * max(distance - clearance, 0.0)))
    return safe
