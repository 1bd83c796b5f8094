"""One person follows their plan within human limits."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from common.geometry.transforms import wrap
from lab.motion.walker import SEAT_BEHIND, SIT_S, STEP_S, Walker
from lab.scenario import PersonPlan, Waypoint


def walk(plan: PersonPlan, seconds: float, each: Callable[[Walker], None] | None = None) -> Walker:
    """Simulate one walker without others."""
    walker = Walker(plan, 1.75)
    for step in range(round(seconds / STEP_S)):
        walker.decide(step * STEP_S)
        walker.move(walker.bearing_rad(), walker.cruise_mps if walker.goal_m else 0.0)
        if each is not None:
            each(walker)
    return walker


def test_speed_and_turning_change_within_human_limits() -> None:
    corners = ((2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 0.0))
    path = tuple(Waypoint(to=corner, stop_s=1.0 if corner[0] else 0.0) for corner in corners)
    log: list[tuple[float, float, float]] = []
    walk(
        PersonPlan(body="adam", start=(0, 0), speed_mps=1.4, path=path, repeat=True),
        30.0,
        lambda walker: log.append((walker.speed_mps, walker.yaw_rad, walker.turn_radps)),
    )
    speed, yaw, turning = np.array(log).T
    assert speed.max() == pytest.approx(1.4, abs=0.05)
    assert speed.min() >= 0.0
    assert np.abs(np.diff(speed)).max() / STEP_S <= 1.4
    assert np.abs(np.diff(yaw)).max() / STEP_S <= 2.4
    assert np.abs(np.diff(turning)).max() / STEP_S <= 8.0


def test_stops_at_the_waypoint_and_faces_as_planned() -> None:
    plan = PersonPlan(
        body="adam", start=(0, 0), face_deg=0, path=(Waypoint(to=(2, 1), stop_s=30, face_deg=-90),)
    )
    at_8 = walk(plan, 8.0)
    assert math.hypot(at_8.x_m - 2, at_8.y_m - 1) < 0.12
    assert wrap(at_8.yaw_rad + math.pi / 2) == pytest.approx(0.0, abs=math.radians(4))
    at_20 = walk(plan, 20.0)
    assert (at_20.x_m, at_20.y_m) == pytest.approx((at_8.x_m, at_8.y_m), abs=0.002)


def test_waits_before_the_first_step() -> None:
    plan = PersonPlan(body="adam", start=(0, 0), face_deg=0, wait_s=3, path=(Waypoint(to=(3, 0)),))
    assert walk(plan, 3.0).x_m == 0.0
    assert walk(plan, 4.0).x_m > 0.2


def test_stays_as_long_as_planned_and_continues() -> None:
    plan = PersonPlan(
        body="adam",
        start=(0, 0),
        face_deg=0,
        path=(Waypoint(to=(1, 0), stop_s=5.0, turn_head=True), Waypoint(to=(3, 0))),
    )
    looking: list[bool] = []
    positions: list[float] = []

    def note(walker: Walker) -> None:
        looking.append(walker.looking)
        positions.append(walker.x_m)

    walk(plan, 15.0, note)
    here = np.abs(np.array(positions) - 1.0) < 0.1
    # Five seconds, and the time to brake and to set off.
    assert 4.5 < here.sum() * STEP_S < 6.5
    assert 4.0 < np.sum(looking) * STEP_S < 5.1
    assert positions[-1] == pytest.approx(3.0, abs=0.12)


def test_passes_a_waypoint_without_stopping() -> None:
    plan = PersonPlan(
        body="adam",
        start=(0, 0),
        face_deg=0,
        speed_mps=1.0,
        path=(Waypoint(to=(2, 0)), Waypoint(to=(4, 0.3))),
    )
    log: list[tuple[float, float, float]] = []
    walk(plan, 3.5, lambda walker: log.append((walker.x_m, walker.y_m, walker.speed_mps)))
    x, y, speed = np.array(log).T
    assert np.hypot(x - 2, y).min() < 0.35
    assert speed[x > 1.0].min() > 0.9


def test_a_person_without_a_path_stands() -> None:
    walker = walk(PersonPlan(body="adam", start=(1, 2), face_deg=45), 5.0)
    assert (walker.x_m, walker.y_m, walker.yaw_rad) == (1.0, 2.0, math.radians(45))


def test_path_that_repeats_one_waypoint_ends_no_simulation() -> None:
    plan = PersonPlan(body="adam", start=(1, 2), path=(Waypoint(to=(1, 2)),), repeat=True)
    assert walk(plan, 2.0).x_m == pytest.approx(1.0, abs=0.3)


def test_sits_down_with_the_back_to_the_stool() -> None:
    plan = PersonPlan(
        body="adam",
        start=(0, 0),
        face_deg=0,
        path=(Waypoint(to=(2, 0), sit=True, stop_s=10, face_deg=90), Waypoint(to=(4, 0))),
    )
    seated: list[float] = []
    walker = walk(plan, 8.0, lambda walker: seated.append(walker.seated))
    # The stool is at (2, 0); 0.215 x 1.75 m = 0.376 m in front of it is (2, 0.376).
    assert (walker.x_m, walker.y_m) == pytest.approx((2.0, SEAT_BEHIND * 1.75), abs=0.12)
    assert walker.stool_m == (2.0, 0.0)
    assert seated[-1] == 1.0
    assert np.abs(np.diff(seated)).max() == pytest.approx(STEP_S / SIT_S)
    later = walk(plan, 20.0)
    assert later.stool_m is None
    assert later.x_m == pytest.approx(4.0, abs=0.12)
