"""Walking styles: limp, cadence, lean and arms."""

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from lab.scenario import PersonPlan, Scenario, WalkStyle, Waypoint
from lab.truth.motion_capture import footfalls
from lab.world import World
from people4d.messages import F64

PLAN = PersonPlan(body="adam", start=(0.0, 0.0), face_deg=0, path=(Waypoint(to=(8.0, 0.0)),))
SHOULDERS, HIPS, WRISTS = [5, 6], [11, 12], [9, 10]  # COCO
WALKING_S = np.arange(3.0, 6.0, 0.05)


def walking(**style: Any) -> World:
    """One person walks ahead for 10 s."""
    plan = replace(PLAN, style=WalkStyle(**style))
    return World(Scenario(about="One walks ahead.", duration_s=10.0, room="hall", people=(plan,)))


def step_times(world: World) -> tuple[F64, F64]:
    """Return the times of left and right steps in even walking."""
    falls = footfalls(world, 0)
    times_s = np.diff([one.time_s for one in falls])[2:-2]
    sides = np.array([one.side for one in falls])[3:-2]
    return times_s[sides == 0], times_s[sides == 1]


@pytest.mark.parametrize("limp", [-0.2, -0.1, 0.0, 0.1, 0.2])
def test_limp_is_the_asymmetry_of_step_times(limp: float) -> None:
    left, right = step_times(walking(limp=limp))
    mean_s = (left.mean() + right.mean()) / 2
    assert (left.mean() - right.mean()) / mean_s == pytest.approx(limp, abs=0.01)
    usual = np.concatenate(step_times(walking()))
    assert mean_s == pytest.approx(usual.mean(), rel=0.02)


def test_quick_steps_are_short() -> None:
    usual, quick = (np.concatenate(step_times(walking(cadence=c))) for c in (1.0, 1.25))
    assert usual.mean() / quick.mean() == pytest.approx(1.25, rel=0.04)


def test_bent_torso_leans_forward() -> None:
    joints = [walking(lean_deg=angle).keypoints_m(4.0)[0] for angle in (0.0, 25.0)]
    ahead = [one[SHOULDERS].mean(axis=0) - one[HIPS].mean(axis=0) for one in joints]
    angles = [math.degrees(math.atan2(one[0], one[2])) for one in ahead]
    assert 15 < angles[1] - angles[0] < 30


@pytest.mark.parametrize("arms", ["pockets", "carry"])
def test_arms_that_do_not_swing(arms: str) -> None:
    def swing_m(world: World) -> float:
        joints = np.array([world.keypoints_m(float(t))[0] for t in WALKING_S])
        off = joints[:, WRISTS, 0] - joints[:, HIPS, 0].mean(axis=1, keepdims=True)
        return float(np.ptp(off, axis=0).max())

    assert swing_m(walking(arms=arms)) < 0.5 * swing_m(walking())
