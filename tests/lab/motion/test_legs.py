"""Feet stand still on the floor and legs reach them."""

import functools
import itertools

import numpy as np
import pytest

from lab.bodies.rotations import turn
from lab.motion.foot_path import FootPath, foot_path
from lab.motion.footfalls import FootStances
from lab.motion.limbs import bend_leg, smooth_cover
from lab.motion.motion import PersonMotion, simulate
from lab.scenario import PersonPlan, Waypoint
from people4d.messages import F64
from tests.lab.motion.joint_positions import Joints, joints, pitch_deg, speeds
from tests.lab.motion.skeletons import skeleton

BODY = skeleton(1.75)

# Means of healthy adults at 1.3 m/s, rounded after Winter 1991 and Perry & Burnfield 2010, at 0, 5,
# ... 95 % of the cycle, degrees: the thigh against the vertical (the hip's angle less 8 degrees of
# pelvic tilt) and the bend of the knee. The constants of foot_path.py and footfalls.py were chosen
# with these curves in view, so the test guards the walk and does not validate it.
THIGH_DEG = [21, 20, 18, 14, 9, 4, -1, -6, -11, -15, -18, -17, -12, -3, 7, 15, 21, 24, 24, 22]
KNEE_DEG = [5, 11, 17, 19, 17, 13, 9, 6, 5, 8, 14, 25, 40, 54, 62, 61, 50, 32, 14, 4]

PLANS = {
    "straight": PersonPlan(
        body="adam", start=(0, 0), face_deg=0, speed_mps=1.3, path=(Waypoint(to=(9, 0)),)
    ),
    "slow": PersonPlan(
        body="adam", start=(0, 0), face_deg=0, speed_mps=0.5, path=(Waypoint(to=(4, 0)),)
    ),
    "turning on the spot": PersonPlan(
        body="adam",
        start=(0, 0),
        face_deg=0,
        path=(
            Waypoint(to=(0, 0), stop_s=4, face_deg=170),
            Waypoint(to=(0.3, 0), stop_s=3, face_deg=90),
        ),
    ),
    "square": PersonPlan(
        body="adam",
        start=(0, 0),
        face_deg=0,
        speed_mps=1.2,
        path=tuple(Waypoint(to=position) for position in [(1.6, 0), (1.6, 1.6), (0, 1.6), (0, 0)]),
        repeat=True,
    ),
    "sitting": PersonPlan(
        body="adam", start=(0, 0), face_deg=0, path=(Waypoint(to=(1, 0), sit=True, stop_s=9),)
    ),
}


TIMES_S = np.arange(-0.5, 9.5, 0.008)


@functools.cache
def motion(name: str) -> PersonMotion:
    return simulate([PLANS[name]], [BODY], 9.0, 3)[0]


@functools.cache
def walked(name: str) -> Joints:
    return joints(motion(name), BODY, TIMES_S)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANS)
def test_a_flat_foot_does_not_slide(name: str) -> None:
    body = walked(name)
    flat = (body.heel[..., 2] < 0.001) & (body.ball[..., 2] < 0.001)
    # Only where the foot is flat for some time: a swinging foot is flat for an instant, too.
    held = np.all([np.roll(flat, k, axis=0) for k in range(-2, 3)], axis=0)[2:-3]
    sliding = np.maximum(speeds(body.heel, TIMES_S), speeds(body.ball, TIMES_S))[2:-2]
    assert held.any(axis=0).all()
    assert np.median(sliding[held]) < 0.02
    assert np.max(sliding[held]) < 0.08


@pytest.mark.parametrize("name", PLANS)
def test_no_foot_sinks_into_the_floor(name: str) -> None:
    body = walked(name)
    assert body.heel[..., 2].min() > -0.003
    assert body.ball[..., 2].min() > -0.003
    # The tip of the shoe bends, which a rigid foot segment cannot show.
    assert body.toe[..., 2].min() > -0.025


@pytest.mark.parametrize("name", PLANS)
def test_knees_bend_forward_and_within_human_range(name: str) -> None:
    body = walked(name)
    thigh, shank = body.knee - body.hip, body.ankle - body.knee
    bend = np.degrees(
        np.arccos(
            np.sum(thigh * shank, axis=-1)
            / np.linalg.norm(thigh, axis=-1)
            / np.linalg.norm(shank, axis=-1)
        )
    )
    assert bend.min() > 1.0
    assert bend.max() < 110.0
    forward = body.toe - body.heel
    middle = (body.hip + body.ankle) / 2.0
    assert np.sum((body.knee - middle) * forward, axis=-1).min() > 0.0


def cycles(found: PersonMotion, times_s: F64) -> list[tuple[float, float]]:
    """Return begin and end of the left leg's cycles: from foremost to foremost."""
    body = joints(found, BODY, times_s)
    ahead = body.ankle[:, 0, 0] - body.hip.mean(axis=1)[:, 0]
    foremost = (ahead[1:-1] > ahead[:-2]) & (ahead[1:-1] >= ahead[2:]) & (ahead[1:-1] > 0.1)
    return list(itertools.pairwise(times_s[1:-1][foremost].tolist()))


def test_hip_and_knee_follow_the_published_curves() -> None:
    found = motion("straight")
    times_s = np.arange(2.5, 6.0, 0.01)
    body = joints(found, BODY, times_s)
    forward = np.zeros_like(times_s)
    # Angles count from the neutral pose, in which knee and ankle are a little out of line.
    thigh = pitch_deg(body.hip[:, 0], body.knee[:, 0], forward)
    thigh -= pitch_deg(BODY.hip, BODY.knee, np.zeros(2))[0]
    shank = pitch_deg(body.knee[:, 0], body.ankle[:, 0], forward)
    shank -= pitch_deg(BODY.knee, BODY.ankle, np.zeros(2))[0]
    knee = thigh - shank
    down = (body.heel[1:, 0, 2] < 0.002) & (speeds(body.heel[:, 0], times_s) < 0.3)
    contacts = times_s[1:-1][down[1:] & ~down[:-1]]
    assert len(contacts) >= 2
    at = contacts[0] + np.arange(20) / 20 * (contacts[1] - contacts[0])

    def rms(values: F64, published: list[int]) -> float:
        return float(np.sqrt(np.mean((np.interp(at, times_s, values) - published) ** 2)))

    # People differ by 5 to 8 degrees (one standard deviation) from these means themselves.
    assert rms(thigh, THIGH_DEG) < 8.0
    assert rms(knee, KNEE_DEG) < 10.0
    assert 55.0 < knee.max() < 75.0


def test_step_length_times_cadence_is_speed() -> None:
    found = motion("straight")
    spans = cycles(found, np.arange(2.0, 6.5, 0.01))
    assert len(spans) >= 2
    for begin, end in spans:
        stride = found.path([end])[0, 0] - found.path([begin])[0, 0]
        assert stride / (end - begin) == pytest.approx(1.3, abs=0.02)
        # sqrt(0.384 x 1.3) x (1.75 / 1.70)^0.75 = 0.722 m for a step; persons differ by 5 %.
        assert stride / 2 == pytest.approx(0.722, rel=0.09)


def test_the_right_leg_does_the_same_half_a_cycle_later() -> None:
    found = motion("straight")
    spans = cycles(found, np.arange(2.0, 6.5, 0.01))
    begin, end = spans[0]
    times_s = np.linspace(begin, end, 40)
    later = joints(found, BODY, times_s + (end - begin) / 2)
    now = joints(found, BODY, times_s)
    left = now.ankle[:, 0] - now.hip.mean(axis=1)
    right = later.ankle[:, 1] - later.hip.mean(axis=1)
    assert np.abs(left - right * (1.0, -1.0, 1.0)).max() < 0.015


def test_a_foot_rolls_where_it_stands() -> None:
    # One stride of 1.4 m: stands from -inf to 1 s, lands at 1.4 s and is lifted at 2.1 s, ...
    feet = FootStances(
        np.array([-np.inf, 1.4, 2.5]),
        np.array([1.0, 2.1, np.inf]),
        np.array([[0.0, 0.1, 0.0], [1.4, 0.1, 0.1], [2.8, 0.2, 0.2]]),
    )
    times_s = np.arange(0.0, 3.5, 0.002)
    path = foot_path(feet, BODY, 0, times_s)
    heel, ball, toe = (
        path.ankle_m + turn(path.map_from_foot, point[0] - BODY.ankle[0])
        for point in (BODY.heel, BODY.ball, BODY.toe)
    )
    # The tip of the toes on the floor: bent up about the ball.
    length = float(toe[0, 0] - ball[0, 0])
    reach = np.sqrt(np.maximum(length**2 - ball[:, 2] ** 2, 0.0))
    heading = path.map_from_foot[:, :, 0] * (1.0, 1.0, 0.0)
    heading /= np.linalg.norm(heading, axis=-1, keepdims=True)
    tip = ball * (1.0, 1.0, 0.0) + heading * reach[:, None]
    contact = np.min([speeds(point, times_s) for point in (heel, ball, tip)], axis=0)
    for down, up in zip([0.0, 1.42, 2.52], [0.99, 2.09, 3.4], strict=True):
        inside = (times_s[1:] > down) & (times_s[1:] < up)
        assert np.median(contact[inside]) < 0.02
        assert contact[inside].max() < 0.08
    swings = ((times_s > 1.02) & (times_s < 1.38)) | ((times_s > 2.12) & (times_s < 2.48))
    assert np.minimum(heel[swings, 2], ball[swings, 2]).min() > 0.0
    # Continuous: nowhere faster than 6 m/s.
    assert speeds(path.ankle_m, times_s).max() < 6.0


def test_a_leg_reaches_its_foot() -> None:
    rng = np.random.default_rng(1)
    hip = rng.uniform(-1.0, 1.0, (200, 3))
    # Legs are 0.245 + 0.24 of 1.75 m = 0.85 m long.
    away = rng.normal(size=(200, 3)) * (0.3, 0.2, 0.1) + (0.0, 0.0, -0.6)
    away *= (rng.uniform(0.3, 0.84, 200) / np.linalg.norm(away, axis=-1))[:, None]
    foot = FootPath(hip + away, np.repeat(np.eye(3)[None], 200, axis=0))
    forward = np.repeat([[1.0, 0.0, 0.0]], 200, axis=0)
    for side in (0, 1):
        thigh, shank = bend_leg(hip, foot, forward, BODY, side)
        knee = hip + turn(thigh, BODY.knee[side] - BODY.hip[side])
        ankle = knee + turn(shank, BODY.ankle[side] - BODY.knee[side])
        np.testing.assert_allclose(ankle, foot.ankle_m, atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(thigh), 1.0)


def test_a_foot_out_of_reach_stretches_the_leg_towards_it() -> None:
    hip = np.zeros((1, 3))
    foot = FootPath(np.array([[0.6, 0.0, -1.2]]), np.eye(3)[None])
    thigh, shank = bend_leg(hip, foot, np.array([[1.0, 0.0, 0.0]]), BODY, 0)
    ankle = turn(thigh, BODY.knee[0] - BODY.hip[0]) + turn(shank, BODY.ankle[0] - BODY.knee[0])
    # 0.6 : -1.2 as to the foot, 0.9995 of the leg long.
    assert ankle[0, 0] / ankle[0, 2] == pytest.approx(-0.5)
    assert np.linalg.norm(ankle[0]) == pytest.approx(0.85, abs=0.01)


def test_the_cover_is_smooth_and_nowhere_below() -> None:
    values = np.maximum(np.sin(np.arange(400) * 0.05) - 0.8, 0.0) * 0.1
    cover = smooth_cover(values)
    assert (cover >= values - 1e-12).all()
    assert np.abs(np.diff(cover, 2)).max() < 0.002
    assert cover[-1] >= 0.0
