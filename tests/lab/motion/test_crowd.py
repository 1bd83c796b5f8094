"""People avoid each other and the robot."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from lab.motion.motion import simulate
from lab.scenario import PersonPlan, Waypoint
from people4d.messages import F64
from tests.lab.motion.skeletons import skeleton


def routes(people: Sequence[PersonPlan], seconds: float) -> F64:
    """Return the paths of people, NxTx3 at 50 Hz."""
    motions = simulate(people, [skeleton(1.75) for _ in people], seconds, 0)
    times_s = np.arange(0.0, seconds, 0.02)
    return np.array([motion.path(times_s) for motion in motions])


def nearest_m(found: F64) -> float:
    """Return the minimum distance of two people."""
    return min(
        float(np.linalg.norm(a[:, :2] - b[:, :2], axis=-1).min())
        for k, a in enumerate(found)
        for b in found[:k]
    )


def across(start: tuple[float, float], end: tuple[float, float]) -> PersonPlan:
    face_deg = math.degrees(math.atan2(end[1] - start[1], end[0] - start[0]))
    return PersonPlan(body="adam", start=start, face_deg=face_deg, path=(Waypoint(to=end),))


def test_four_crossing_people_arrive_without_contact() -> None:
    ends = [(2.5, 0.0), (-2.5, 0.0), (0.0, 2.5), (0.0, -2.5)]
    people = [across(start, (-start[0], -start[1])) for start in ends]
    found = routes(people, 14.0)
    assert nearest_m(found) > 0.55
    for route, start in zip(found, ends, strict=True):
        assert route[-1, :2] == pytest.approx((-start[0], -start[1]), abs=0.15)


def test_two_people_who_meet_head_on_pass_on_the_right() -> None:
    found = routes([across((0, 0), (5, 0)), across((5, 0), (0, 0))], 9.0)
    assert nearest_m(found) > 0.55
    meeting = int(np.argmin(np.linalg.norm(found[0, :, :2] - found[1, :, :2], axis=-1)))
    assert found[0, meeting, 1] < 0.0 < found[1, meeting, 1]
    assert found[0, -1, 0] == pytest.approx(5.0, abs=0.15)
    assert found[1, -1, 0] == pytest.approx(0.0, abs=0.15)


def test_a_crowded_room_for_half_a_minute() -> None:
    positions = [(1.5, -1.0), (4.5, 1.0), (1.5, 1.0), (4.5, -1.0), (3.0, 0.0)]
    people = [
        PersonPlan(
            body="adam",
            start=positions[k],
            path=tuple(Waypoint(to=positions[(k + 2 * j + 1) % 5]) for j in range(5)),
            speed_mps=0.7 + 0.15 * k,
            repeat=True,
        )
        for k in range(4)
    ]
    found = routes(people, 30.0)
    assert nearest_m(found) > 0.45
    moved = np.linalg.norm(np.diff(found[..., :2], axis=1), axis=-1).sum(axis=1)
    assert moved.min() > 7.0  # no person is stuck


def test_occupied_goal_is_given_up() -> None:
    first = PersonPlan(
        body="adam",
        start=(0, 0),
        face_deg=0,
        path=(Waypoint(to=(4, 0), stop_s=1), Waypoint(to=(0, 0))),
    )
    found = routes([first, PersonPlan(body="adam", start=(4, 0))], 25.0)
    assert nearest_m(found) > 0.5
    assert found[0, -1, :2] == pytest.approx((0.0, 0.0), abs=0.15)


@pytest.mark.parametrize("speed_mps", [0.0, 0.5])
def test_people_walk_round_the_robot(speed_mps: float) -> None:
    def position(t_s: float) -> F64:
        return np.array([speed_mps * t_s, 0.0, 0.0])

    (motion,) = simulate([across((5, 0.05), (-1, 0))], [skeleton()], 10.0, 0, obstacle=position)
    times_s = np.arange(0.0, 10.0, 0.05)
    robot = np.array([position(t)[:2] for t in times_s])
    assert np.linalg.norm(motion.path(times_s)[:, :2] - robot, axis=-1).min() > 0.55
    assert motion.path([10.0])[0, 0] < 0.0


def test_people_stay_on_the_free_floor() -> None:
    area_m = np.array([[-0.5, -0.6], [5.5, 0.6]])
    people = [across((0, 0), (5, 0)), across((5, 0), (0, 0))]
    motions = simulate(people, [skeleton()] * 2, 10.0, 0, area_m=area_m)
    for motion in motions:
        y = motion.path(np.arange(0.0, 10.0, 0.05))[:, 1]
        assert np.abs(y).max() < 0.75


def test_stool_is_walked_round_even_by_its_user() -> None:
    # The stool is between the person and the point in front of it, from which the person sits down.
    sitter = PersonPlan(
        body="adam",
        start=(0, 0),
        face_deg=0,
        path=(Waypoint(to=(3, 0), sit=True, stop_s=6, face_deg=0), Waypoint(to=(0, 0))),
    )
    passer = PersonPlan(
        body="adam", start=(5.5, 0.2), wait_s=16, path=(Waypoint(to=(0.8, 0.9)),), speed_mps=1.2
    )
    motions = simulate([sitter, passer], [skeleton(1.75)] * 2, 25.0, 0)
    times_s = np.arange(0.0, 25.0, 0.02)
    for motion in motions:
        route = motion.path(times_s)[:, :2]
        assert np.linalg.norm(route - (3.0, 0.0), axis=-1).min() > 0.28
    # Seated after 8 s: the pelvis is above the stool.
    assert motions[0].at(9.0).map_from_pelvis[:2, 3] == pytest.approx((3.0, 0.0), abs=0.13)
    assert motions[0].path([25.0])[0, :2] == pytest.approx((0.0, 0.0), abs=0.2)
