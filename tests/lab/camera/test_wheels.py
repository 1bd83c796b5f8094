"""Wheel odometry: exact without errors, and consistent with its covariance."""

import math

import numpy as np
import pytest

from common.geometry.transforms import wrap
from lab.camera.base_path import BasePath
from lab.camera.plan import CameraPlan, Drive
from lab.camera.wheels import WHEELS, DeadReckoning, WheelModel, tick_m, wheel_odometry, wheel_ticks
from people4d.messages import F64, Odometry

PERFECT = WheelModel(scale_error=0, track_error=0, slip=0, ticks_per_turn=10**6)
DRIVES = (
    Drive(for_s=5, speed_mps=0.4),
    Drive(for_s=6, speed_mps=0.3, turn_dps=25),
    Drive(for_s=5, turn_dps=-40),
    Drive(for_s=4, speed_mps=0.3),
)


def odometry(
    wheels: WheelModel, drive: tuple[Drive, ...] = DRIVES, seed: int = 1
) -> list[Odometry]:
    return wheel_odometry(BasePath(CameraPlan(drive=drive), 20), 20, seed, wheels)


def pose(message: Odometry) -> F64:
    return np.array([message.x_m, message.y_m, message.theta_rad])


def test_half_a_turn_by_hand() -> None:
    # Track 0.3 m: left -0.1 m, right +0.1 m turn by 0.2 / 0.3 = 2/3 rad on the spot. Then both
    # 0.5 m: half a metre along 2/3 rad. Then an arc: left 0.2, right 0.5 m: 0.35 m, 1 rad,
    # along the middle heading 2/3 + 1/2.
    reckoning = DeadReckoning()
    reckoning.add_step(-0.1, 0.1)
    assert reckoning.pose == pytest.approx([0, 0, 2 / 3])
    reckoning.add_step(0.5, 0.5)
    assert reckoning.pose == pytest.approx([0.5 * math.cos(2 / 3), 0.5 * math.sin(2 / 3), 2 / 3])
    before = reckoning.pose
    reckoning.add_step(0.2, 0.5)
    middle = 2 / 3 + 1 / 2
    moved = [0.35 * math.cos(middle), 0.35 * math.sin(middle), 1.0]
    assert reckoning.pose - before == pytest.approx(moved)
    assert reckoning.twist == pytest.approx([0.35 * 50, 0, 50])


def test_perfect_wheels_give_the_pose() -> None:
    path = BasePath(CameraPlan(drive=DRIVES), 20)
    messages = wheel_odometry(path, 20, 1, PERFECT)
    assert len(messages) == 20 * 50 + 1
    assert (messages[0].frame_id, messages[0].child_frame_id) == ("odom", "base_link")
    for message in messages[::100]:
        expected = path.pose(message.stamp_ns / 1e9)
        assert pose(message) == pytest.approx(expected, abs=2e-4)
    assert messages[-1].stamp_ns == 20_000_000_000
    assert [m.sequence for m in messages[:3]] == [0, 1, 2]
    twist = messages[100].twist  # at 2 s, straight on
    assert twist is not None
    assert twist == pytest.approx([0.4, 0, 0], abs=1e-3)


def test_odometry_begins_at_zero_for_any_pose_of_the_camera() -> None:
    plan = CameraPlan(at=(3.0, 1.0, 1.15), yaw_deg=120, drive=DRIVES)
    path = BasePath(plan, 20)
    messages = wheel_odometry(path, 20, 1, PERFECT)
    assert pose(messages[0]).tolist() == [0, 0, 0]
    map_from_odom = path.map_from_base(0.0)
    last = messages[-1]
    assert map_from_odom @ [last.x_m, last.y_m, 0, 1] == pytest.approx(
        [*path.pose(20.0)[:2], 0, 1], abs=2e-4
    )


def test_ticks_of_a_straight_drive() -> None:
    # 0.5 m/s * 4 s = 2 m; a tick is 2 pi 0.0325 / 4096 = 49.8544 um: 40116.8 ticks, both wheels.
    wheels = WheelModel(scale_error=0, track_error=0, slip=0)
    plan = CameraPlan(drive=(Drive(for_s=4, speed_mps=0.5),))
    assert tick_m(wheels) == pytest.approx(49.8544e-6, rel=1e-5)
    times_s, ticks = wheel_ticks(BasePath(plan, 4), 4, 0, wheels)
    assert ticks[-1].tolist() == [40117, 40117]
    assert ticks[0].tolist() == [0, 0]
    assert times_s[-1] == 4.0


def test_constant_errors_scale_distances_and_turns() -> None:
    straight = (Drive(for_s=20, speed_mps=0.5),)
    scaled = WheelModel(scale_error=0.01, track_error=0.02, slip=0)
    # 10 m true, 1 % too much: 10.1 m.
    assert pose(odometry(scaled, straight)[-1]) == pytest.approx([10.1, 0, 0], abs=1e-3)
    # 20 s * 8 deg/s = 160 deg true; 1 % of scale and 2 % of track too much: 164.8 deg.
    turned = odometry(scaled, (Drive(for_s=20, turn_dps=8),))[-1].theta_rad
    assert math.degrees(turned) == pytest.approx(160 * 1.01 * 1.02, abs=0.05)


@pytest.mark.slow
def test_errors_stay_within_the_covariance() -> None:
    # The mean of e^T P^-1 e over many runs is 3 if the covariance is right. The constant errors
    # are drawn from a normal distribution with their nominal size.
    generator = np.random.default_rng(4)
    usual = WheelModel(rate_hz=10)
    path = BasePath(CameraPlan(drive=DRIVES), 20)
    covariance = wheel_odometry(path, 20, 0, usual)[-1].covariance
    assert covariance is not None
    distances = []
    for seed in range(100):
        scale, track = generator.normal(0, 0.01, 2)
        wheels = WheelModel(rate_hz=10, scale_error=scale, track_error=track)
        last = wheel_odometry(path, 20, seed, wheels)[-1]
        error = pose(last) - path.pose(20.0)
        error[2] = wrap(error[2])
        distances.append(error @ np.linalg.solve(covariance, error))
    # Chi-square, 3 degrees of freedom: standard deviation sqrt(6), of the mean sqrt(6/100) = 0.24.
    assert np.mean(distances) == pytest.approx(3, abs=0.8)


def test_covariance_grows_only_while_driving() -> None:
    messages = odometry(WHEELS, (Drive(for_s=5, speed_mps=0.4), Drive(for_s=15)))
    spread = [float(np.trace(m.covariance)) for m in messages if m.covariance is not None]
    assert len(spread) == len(messages)
    assert spread[0] > 0
    assert spread[300] > 10 * spread[50] > 0
    assert spread[-1] == pytest.approx(spread[400])
    covariances = [m.covariance for m in messages[::50] if m.covariance is not None]
    assert np.linalg.eigvalsh(np.stack(covariances)).min() > 0


def test_slip_depends_on_the_seed_alone() -> None:
    first, again, other = (odometry(WHEELS, seed=s)[-1] for s in (1, 1, 2))
    assert pose(first).tolist() == pose(again).tolist()
    assert pose(first).tolist() != pose(other).tolist()
