"""Odometry of two wheels, worked by hand."""

import math

import pytest

from common.geometry.wheel_odometry import WheelConfig, WheelOdometry

# 100 ticks are a distance of 1 m; the wheels are 0.5 m apart.
WHEELS = WheelConfig(radius_m=1 / (2 * math.pi), track_m=0.5, ticks_per_turn=100)


def test_equal_steps_move_straight() -> None:
    wheels = WheelOdometry(WHEELS)
    wheels.add_reading(0, 1_000, 2_000)  # encoders start anywhere
    pose = wheels.add_reading(1, 1_050, 2_050)
    assert (pose.x_m, pose.y_m, pose.theta_rad) == pytest.approx((0.5, 0.0, 0.0))


def test_rotation_about_the_centre_to_the_left() -> None:
    # Right 0.1 m forward, left 0.1 m back: 0.2 / 0.5 = 0.4 rad counter-clockwise.
    wheels = WheelOdometry(WHEELS)
    wheels.add_reading(0, 0, 0)
    pose = wheels.add_reading(1, -10, 10)
    assert (pose.x_m, pose.y_m, pose.theta_rad) == pytest.approx((0.0, 0.0, 0.4))


def test_arc_follows_the_mean_heading() -> None:
    # 0.2 m and 0.4 m: 0.3 m forward, 0.4 rad; along 0.2 rad.
    wheels = WheelOdometry(WHEELS)
    wheels.add_reading(0, 0, 0)
    pose = wheels.add_reading(1, 20, 40)
    assert pose.x_m == pytest.approx(0.3 * math.cos(0.2))
    assert pose.y_m == pytest.approx(0.3 * math.sin(0.2))
    assert pose.theta_rad == pytest.approx(0.4)


def test_default_track_gives_the_rotation() -> None:
    # Wheels of 0.035 m, 374 ticks a turn, 0.108 m apart: one turn forward of the right and back of
    # the left is 2 * 2 pi 0.035 / 0.108 rad.
    wheels = WheelOdometry(WheelConfig(ticks_per_turn=374))
    wheels.add_reading(0, 0, 0)
    turned_rad = 4 * math.pi * 0.035 / 0.108
    assert wheels.add_reading(1, -374, 374).theta_rad == pytest.approx(turned_rad - 2 * math.pi)


def test_encoder_overflow_is_unwrapped() -> None:
    wheels = WheelOdometry(
        WheelConfig(radius_m=1 / (2 * math.pi), track_m=0.5, ticks_per_turn=100, wraps_at=256)
    )
    wheels.add_reading(0, 250, 3)
    pose = wheels.add_reading(1, 4, 13)  # 10 ticks each: from 250 over 256 = 0 to 4
    assert (pose.x_m, pose.theta_rad) == pytest.approx((0.1, 0.0))
    pose = wheels.add_reading(2, 250, 3)  # and back
    assert (pose.x_m, pose.theta_rad) == pytest.approx((0.0, 0.0))


def test_config_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match="track_m: expected a finite number > 0, got 0"):
        WheelConfig(track_m=0)
    with pytest.raises(ValueError, match="wraps_at: expected >= 0, got -1"):
        WheelConfig(wraps_at=-1)
