"""Footfalls, planned from the entire path of a person.

A foot is put where the body will be in the middle of its stance, so feet turn, start and stop as
the body does. A bout of steps begins and ends with both feet below the body.
"""

import math
from dataclasses import dataclass

import numpy as np

from lab.motion.bouts import WalkingBout, WalkPath, find_walking_bouts, limping
from people4d.messages import F64

SIDES = (1.0, -1.0)  # left, right; index 0 and 1 in all arrays of feet

MIDSTANCE = 0.365  # part of the stance after which the body is above the foot
WALKING_HALF_WIDTH_M = 0.055  # of the base of support, ankle to the middle
WALKING_MPS = 0.7  # from there on the base is so narrow
TOE_OUT_RAD = math.radians(7.0)


@dataclass(frozen=True)
class FootStances:
    """The stances of one foot, K of them; stance k lasts from down_s[k] to up_s[k]."""

    down_s: F64  # the first is -inf
    up_s: F64  # the last is inf
    footprint: F64  # Kx3: x and y of the ankle and yaw of the foot while it is flat, frame: map


@dataclass(frozen=True)
class StepPlan:
    """All steps of one person."""

    feet: tuple[FootStances, FootStances]  # left and right
    phase: F64  # T, cycles of the left leg: whole at left heel contact; creeps while standing
    stepping: F64  # T, 1 while stepping, else 0


@dataclass(frozen=True)
class BodyProportions:
    """Proportions and habits of a person that the steps depend on."""

    stature_m: float  # metres
    ankle_ahead_m: float  # of the ankles before the hips, standing
    half_stance_m: float  # ankle to the middle, standing
    quickness: float = 1.0  # cadence over that of the average person
    first_foot: int = 0  # preferred first foot, 0 left or 1 right
    limp: float = 0.0  # (left - right) / mean of the times of steps


def plan_steps(path: WalkPath, body: BodyProportions) -> StepPlan:
    """Plan all steps of a person on a path."""
    bouts = [
        limping(bout, body.limp)
        for bout in find_walking_bouts(path, body.stature_m, body.quickness, body.first_foot)
    ]
    stepping = np.zeros(len(path.times_s))
    for bout in bouts:
        stepping[bout.begin : bout.begin + len(bout.times_s)] = 1.0
    left, right = (_feet(path, body, bouts, side) for side in (0, 1))
    return StepPlan((left, right), _phase(path, bouts), stepping)


def _feet(
    path: WalkPath, body: BodyProportions, bouts: list[WalkingBout], side: int
) -> FootStances:
    down, up, above = [-math.inf], [], [float(path.times_s[0])]
    for bout in bouts:
        for step in range((side - bout.foot) % 2, bout.count, 2):
            up.append(bout.when_s(step))
            down.append(bout.when_s(step + bout.swing))
            last = step + 2 >= bout.count  # so the foot stands when the bout ends
            middle = step + bout.swing + MIDSTANCE * (2.0 - bout.swing)
            above.append(float(bout.times_s[-1]) if last else bout.when_s(middle))
    footprints = _footprints(path, body, np.array(above), side)
    return FootStances(np.array(down), np.array([*up, math.inf]), footprints)


def _footprints(path: WalkPath, body: BodyProportions, above_s: F64, side: int) -> F64:
    """Return where a foot stands, from the times at which the body is above it."""
    x, y, yaw, speed = (
        np.interp(above_s, path.times_s, values)
        for values in (path.x_m, path.y_m, path.yaw_rad, path.speed_mps)
    )
    slow = np.clip(1.0 - speed / WALKING_MPS, 0.0, 1.0)
    width = WALKING_HALF_WIDTH_M + (body.half_stance_m - WALKING_HALF_WIDTH_M) * slow
    left, ahead = SIDES[side] * width, body.ankle_ahead_m
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned = yaw + SIDES[side] * TOE_OUT_RAD
    return np.stack([x + cos * ahead - sin * left, y + sin * ahead + cos * left, turned], axis=-1)


def _phase(path: WalkPath, bouts: list[WalkingBout]) -> F64:
    """Return the cycles of the left leg at all times, creeping from one bout to the next."""
    if not bouts:
        return np.zeros_like(path.times_s)
    cycles: list[F64] = []
    for bout in bouts:
        cycles.append(bout.cycles(float(cycles[-1][-1]) if cycles else 0.0))
    known_s = np.concatenate([bout.times_s for bout in bouts])
    return np.asarray(np.interp(path.times_s, known_s, np.concatenate(cycles)))
