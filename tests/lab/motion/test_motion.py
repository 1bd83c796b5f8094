"""Motion is smooth, lifelike and a pure function of time."""

import functools

import numpy as np
import pytest

from lab.bodies.skeleton import INDEX, map_from_segments
from lab.motion.motion import PersonMotion, simulate
from lab.motion.stance import seated_height_m
from lab.scenario import PersonPlan, Waypoint
from people4d.messages import F64
from tests.lab.motion.joint_positions import joints
from tests.lab.motion.skeletons import skeleton

BODIES = [skeleton(1.75), skeleton(1.62)]
PEOPLE = [
    PersonPlan(
        body="adam",
        start=(0, 0),
        face_deg=0,
        speed_mps=1.3,
        path=(Waypoint(to=(8, 0)), Waypoint(to=(8, 2), stop_s=3, face_deg=180, turn_head=True)),
    ),
    PersonPlan(
        body="bea",
        start=(0, 3),
        face_deg=0,
        path=(Waypoint(to=(2, 4), sit=True, stop_s=9, face_deg=-90), Waypoint(to=(0, 3))),
    ),
]
DURATION_S = 20.0


@functools.cache
def motions() -> tuple[PersonMotion, ...]:
    return simulate(PEOPLE, BODIES, DURATION_S, 5)


def chest_yaw(motion: PersonMotion, times_s: F64) -> F64:
    chests = [map_from_segments(motion.at(float(t)))[INDEX["chest"]] for t in times_s]
    return np.unwrap([np.arctan2(chest[1, 0], chest[0, 0]) for chest in chests])


def test_the_same_seed_gives_the_same_bytes_and_order_does_not_matter() -> None:
    again = simulate(PEOPLE, BODIES, DURATION_S, 5)
    times_s = [3.3, 0.0, 19.99, -1.0, 7.125, 21.0, 3.3]
    for first, second in zip(motions(), again, strict=True):
        forth = [first.at(t) for t in times_s]
        back = [second.at(t) for t in reversed(times_s)]
        for a, b in zip(forth, reversed(back), strict=True):
            assert a.map_from_pelvis.tobytes() == b.map_from_pelvis.tobytes()
            assert a.rotations.tobytes() == b.rotations.tobytes()


def test_another_seed_gives_another_motion() -> None:
    other = simulate(PEOPLE, BODIES, DURATION_S, 6)
    assert np.abs(other[0].at(4.0).rotations - motions()[0].at(4.0).rotations).max() > 1e-3


def test_rotations_are_rotations_at_any_time() -> None:
    for t_s in (-1.0, 0.003, 4.5678, 21.0):
        pose = motions()[0].at(t_s)
        for rotation in [pose.map_from_pelvis[:3, :3], *pose.rotations]:
            np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
            assert np.linalg.det(rotation) == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.parametrize("person", [0, 1])
def test_the_torso_moves_smoothly(person: int) -> None:
    times_s = np.arange(-1.0, 21.0, 0.005)
    torso = joints(motions()[person], BODIES[person], times_s).torso
    velocity = np.diff(torso, axis=0) / 0.005
    # A jump of the velocity would show as its size over 5 ms; people stay below one g.
    assert np.abs(np.diff(velocity, axis=0)).max() / 0.005 < 9.8
    assert np.linalg.norm(velocity, axis=-1).max() < 1.8


def test_the_torso_goes_up_and_down_and_from_side_to_side_as_people_do() -> None:
    times_s = np.arange(2.5, 5.5, 0.01)
    torso = joints(motions()[0], BODIES[0], times_s).torso
    # At 1.3 m/s 4 to 5 cm both ways (Murray 1964).
    assert 0.025 < np.ptp(torso[:, 2]) < 0.055
    assert 0.025 < np.ptp(torso[:, 1]) < 0.065


@pytest.mark.parametrize("person", [0, 1])
def test_chest_stays_near_the_path_and_turns_no_faster_than_people(person: int) -> None:
    times_s = np.arange(0.0, 20.0, 0.01)
    yaw = chest_yaw(motions()[person], times_s)
    assert np.degrees(np.abs(np.diff(yaw)) / 0.01).max() < 200.0
    apart = np.degrees(yaw - motions()[person].path(times_s)[:, 2])
    apart = (apart + 180.0) % 360.0 - 180.0
    assert np.abs(apart).max() < 25.0
    walking = (times_s > 2.5) & (times_s < 5.5)
    if person == 0:
        assert 2.0 < np.ptp(apart[walking]) < 15.0


def test_path_yaw_is_the_direction_of_the_path() -> None:
    motion = motions()[0]
    for t_s in (2.0, 4.0, 7.5):
        before, after = motion.path([t_s - 0.01, t_s + 0.01])
        assert motion.path_yaw(t_s) == pytest.approx(
            np.arctan2(after[1] - before[1], after[0] - before[0]), abs=0.12
        )


def test_arms_swing_against_the_legs() -> None:
    times_s = np.arange(2.5, 5.5, 0.01)
    body = joints(motions()[0], BODIES[0], times_s)
    hand = body.wrist[:, 0, 0] - body.shoulder[:, 0, 0]
    left, right = (body.ankle[:, k, 0] - body.hip[:, k, 0] for k in (0, 1))
    assert np.corrcoef(hand, left)[0, 1] < -0.7
    assert np.corrcoef(hand, right)[0, 1] > 0.7
    assert 0.2 < np.ptp(hand) < 0.7


def test_standing_people_sway_a_little() -> None:
    (motion,) = simulate([PersonPlan(body="adam", start=(1, 1))], [BODIES[0]], 60.0, 2)
    times_s = np.arange(0.0, 60.0, 0.1)
    torso = joints(motion, BODIES[0], times_s).torso
    moved = torso - torso.mean(axis=0)
    assert 0.001 < moved[:, 0].std() < 0.008
    assert np.abs(moved).max() < 0.025
    np.testing.assert_allclose(motion.path(times_s)[:, :2], 1.0)


def test_looking_around_turns_the_head_more_than_the_chest() -> None:
    motion = motions()[0]
    times_s = np.arange(11.5, 13.0, 0.05)
    heads = [map_from_segments(motion.at(float(t)))[INDEX["head"]] for t in times_s]
    head = np.unwrap([np.arctan2(r[1, 0], r[0, 0]) for r in heads])
    route = motion.path(times_s)[:, 2]
    assert np.degrees(np.abs(head - route)).max() > 15.0
    assert np.ptp(chest_yaw(motion, times_s)) < np.ptp(head)


def test_a_seated_person_is_on_the_stool() -> None:
    pose = motions()[1].at(9.0)
    x, y, z = pose.map_from_pelvis[:3, 3]
    # The stool is 0.45 m high; hips are 0.05 x 1.62 m = 0.081 m above the seat.
    assert z == pytest.approx(seated_height_m(1.62)) == pytest.approx(0.531)
    assert (x, y) == pytest.approx((2.0, 4.0), abs=0.13)
    # Hips over knees over feet: thighs level within 20 degrees.
    body = joints(motions()[1], BODIES[1], np.array([9.0]))
    assert np.abs(body.knee[0, :, 2] - body.hip[0, :, 2]).max() < 0.397 * np.sin(np.radians(20))


def test_no_people_no_motion() -> None:
    assert simulate([], [], 5.0, 0) == ()
