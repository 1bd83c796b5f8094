"""Footfalls, planned from the entire path of a person.

A footprint is the position of the body in the middle of the stance, so feet turn, start and stop
with the body. A bout of steps begins and ends with both feet below the body.
"""

import math
from dataclasses import dataclass

import numpy as np

from lab.bodies.skeleton import Skeleton
from lab.motion.bouts import WalkingBout, WalkPath, find_walking_bouts
from lab.scenario import PersonPlan
from people4d.messages import F64

PERSON_KEY = 7100  # key of the random numbers
SIDES = (1.0, -1.0)  # directions of left and right; index 0 and 1 in all arrays of feet

MIDSTANCE = 0.365  # share of the stance before the body is above the foot
WALKING_HALF_WIDTH_M = 0.055  # distance of an ankle from the path in walking [m]
WALKING_MPS = 0.7  # speed above which this distance is constant [m/s]
TOE_OUT_RAD = math.radians(7.0)  # yaw of a foot relative to the path [rad]


@dataclass(frozen=True)
class FootStances:
    """Stances of one foot, K of them; stance k lasts from down_s[k] to up_s[k]."""

    down_s: F64  # the first is -inf
    up_s: F64  # the last is inf
    footprint: F64  # Kx3: x and y of the ankle and yaw of the foot while it is flat, frame: map


@dataclass(frozen=True)
class StepPlan:
    """Steps of one person."""

    feet: tuple[FootStances, FootStances]  # left and right
    phase: F64  # T, cycles of the left leg: whole at left heel contact; creeps while standing
    stepping: F64  # T, 1 while stepping, else 0


@dataclass(frozen=True)
class Individual:
    """A person with their individual differences from others."""

    skeleton: Skeleton
    seed: int  # seed of the scenario
    index: int  # index of the person in the scenario
    cadence_factor: float  # cadence relative to the average person
    arm_swing: float  # amplitude of the arms relative to the average person
    first_foot: int  # preferred first foot, 0 left or 1 right
    plan: PersonPlan  # path and gestures

    @classmethod
    def draw(cls, skeleton: Skeleton, seed: int, index: int, plan: PersonPlan) -> "Individual":
        """Return a person of a scenario."""
        rng = np.random.default_rng([seed, PERSON_KEY, index])
        return cls(
            skeleton,
            seed,
            index,
            cadence_factor=float(rng.uniform(0.95, 1.05)),
            arm_swing=float(rng.uniform(0.75, 1.2)),
            first_foot=int(rng.integers(2)),
            plan=plan,
        )


def plan_steps(path: WalkPath, person: Individual) -> StepPlan:
    """Plan all steps of a person on a path."""
    stature_m = person.skeleton.stature_m
    bouts = find_walking_bouts(path, stature_m, person.cadence_factor, person.first_foot)
    stepping = np.zeros(len(path.times_s))
    for bout in bouts:
        stepping[bout.begin : bout.begin + len(bout.times_s)] = 1.0
    left, right = (_feet(path, person.skeleton, bouts, side) for side in (0, 1))
    return StepPlan((left, right), _phase(path, bouts), stepping)


def _feet(path: WalkPath, body: Skeleton, bouts: list[WalkingBout], side: int) -> FootStances:
    down, up, above = [-math.inf], [], [float(path.times_s[0])]
    for bout in bouts:
        for step in range((side - bout.foot) % 2, bout.count, 2):
            up.append(bout.time_of(step))
            down.append(bout.time_of(step + bout.swing))
            last = step + 2 >= bout.count  # the foot stands at the end of the bout
            middle = step + bout.swing + MIDSTANCE * (2.0 - bout.swing)
            above.append(float(bout.times_s[-1]) if last else bout.time_of(middle))
    footprints = _footprints(path, body, np.array(above), side)
    return FootStances(np.array(down), np.array([*up, math.inf]), footprints)


def _footprints(path: WalkPath, body: Skeleton, above_s: F64, side: int) -> F64:
    """Return the footprints of a foot, from the times at which the body is above it."""
    x, y, yaw, speed = (
        np.interp(above_s, path.times_s, values)
        for values in (path.x_m, path.y_m, path.yaw_rad, path.speed_mps)
    )
    slow = np.clip(1.0 - speed / WALKING_MPS, 0.0, 1.0)
    standing_m = float(abs(body.ankle[0, 1] - body.ankle[1, 1])) / 2.0
    width = WALKING_HALF_WIDTH_M + (standing_m - WALKING_HALF_WIDTH_M) * slow
    left, ahead = SIDES[side] * width, float(body.ankle[:, 0].mean())
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned = yaw + SIDES[side] * TOE_OUT_RAD
    return np.stack([x + cos * ahead - sin * left, y + sin * ahead + cos * left, turned], axis=-1)


def _phase(path: WalkPath, bouts: list[WalkingBout]) -> F64:
    """Return the cycles of the left leg at all times, interpolated between bouts."""
    if not bouts:
        return np.zeros_like(path.times_s)
    cycles: list[F64] = []
    for bout in bouts:
        cycles.append(bout.cycles(float(cycles[-1][-1]) if cycles else 0.0))
    known_s = np.concatenate([bout.times_s for bout in bouts])
    return np.asarray(np.interp(path.times_s, known_s, np.concatenate(cycles)))
