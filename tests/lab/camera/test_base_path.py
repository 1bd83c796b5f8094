"""Path of the robot: goals of drives computed by hand, and no jumps."""

import math

import numpy as np
import pytest

from common.geometry.transforms import apply, invert
from lab.camera.base_path import ACCELERATION_MPS2, TURN_ACCELERATION_RADPS2, BasePath
from lab.camera.plan import CameraPlan, Drive


def test_still_camera() -> None:
    path = BasePath(CameraPlan(at=(1.0, 2.0, 1.15), yaw_deg=90.0, pitch_deg=0.0), 10)
    for t_s in (-1.0, 0.0, 11.0):
        assert path.pose(t_s) == pytest.approx((1, 2, math.pi / 2))
        assert path.twist(t_s) == (0, 0)
    # Yaw 90: the optical axis points along +y. 3 m ahead and 0.5 m to its right (+x), 1 m down.
    point = apply(path.map_from_optical(0.0), [0.5, 1.0, 3.0])
    assert point == pytest.approx([1.5, 5.0, 0.15])


def test_camera_axis_points_down_by_its_pitch() -> None:
    path = BasePath(CameraPlan(at=(0.0, 0.0, 1.0), pitch_deg=30.0), 1)
    # The axis meets the floor 1 / tan(30 deg) = 1.732 m ahead, at 1 / sin(30 deg) = 2 m.
    assert apply(path.map_from_optical(0.0), [0, 0, 2.0]) == pytest.approx([1.732051, 0, 0])


def test_straight_drive_begins_at_speed_and_stops() -> None:
    path = BasePath(CameraPlan(drive=(Drive(for_s=4, speed_mps=0.5),)), 10)
    assert path.twist(0.0) == (0.5, 0)
    assert path.pose(2.0) == pytest.approx((1.0, 0, 0))
    assert path.pose(-1.0) == pytest.approx((-0.5, 0, 0))
    # The ramp to a stand takes as much from the last second as it adds to the next: 4 s * 0.5 m/s.
    assert path.pose(10.0) == pytest.approx((2.0, 0, 0))
    assert path.twist(10.0) == pytest.approx((0, 0))
    # Ramp: pi/2 * 0.5 / 0.5 = 1.571 s, centred on 4 s; half of the speed is left in its middle.
    assert path.twist(4.0)[0] == pytest.approx(0.25)
    assert path.twist(4 - 0.8)[0] == 0.5


def test_turn_on_the_spot() -> None:
    path = BasePath(CameraPlan(drive=(Drive(for_s=9, turn_dps=30),)), 9)
    # The camera stands on the axis of the base, so it stays in place.
    assert path.pose(3.0) == pytest.approx((0, 0, math.pi / 2))
    assert path.pose(8.0)[2] == pytest.approx(math.radians(240 - 360))
    assert path.map_from_optical(5.0)[:3, 3] == pytest.approx([0, 0, 1.15])


def test_circle_closes() -> None:
    # 0.4 m/s and 30 deg/s: 12 s a round, radius 0.4 / (pi/6) = 0.764 m.
    path = BasePath(CameraPlan(drive=(Drive(for_s=12, speed_mps=0.4, turn_dps=30),)), 12)
    assert path.pose(12.0) == pytest.approx((0, 0, 0), abs=1e-9)
    assert path.pose(6.0)[:2] == pytest.approx((0, 2 * 0.4 / (math.pi / 6)), abs=1e-9)


DRIVES = (
    Drive(for_s=3, speed_mps=0.4),
    Drive(for_s=4, speed_mps=0.3, turn_dps=35),
    Drive(for_s=4, speed_mps=0.0, turn_dps=-60),
    Drive(for_s=3, speed_mps=-0.2),
)


def test_nothing_jumps() -> None:
    path = BasePath(CameraPlan(drive=DRIVES), 20)
    times = np.arange(-1, 21, 0.01)
    twists = np.array([path.twist(float(t)) for t in times])
    steepest = np.abs(np.diff(twists, axis=0) / 0.01).max(axis=0)
    assert steepest[0] <= ACCELERATION_MPS2 * 1.001
    assert steepest[1] <= TURN_ACCELERATION_RADPS2 * 1.001


def test_twist_is_the_derivative_of_the_pose() -> None:
    path = BasePath(CameraPlan(drive=DRIVES), 20)
    h = 1e-4
    for t_s in np.arange(0.0123, 20, 0.37).tolist():
        step = invert(path.map_from_base(t_s - h)) @ path.map_from_base(t_s + h) / (2 * h)
        speed_mps, turn_radps = path.twist(t_s)
        assert step[:2, 3] == pytest.approx([speed_mps, 0], abs=1e-4)
        assert step[1, 0] == pytest.approx(turn_radps, abs=1e-4)


def test_total_turn_is_that_of_the_plan() -> None:
    path = BasePath(CameraPlan(drive=DRIVES), 20)
    forward_m, turned_rad = path.travel(np.array([20.0]))[0]
    assert math.degrees(turned_rad) == pytest.approx(4 * 35 - 4 * 60)
    assert forward_m == pytest.approx(3 * 0.4 + 4 * 0.3 - 3 * 0.2)


def test_short_stretches_are_ramped_within_themselves() -> None:
    path = BasePath(CameraPlan(drive=(Drive(for_s=0.2, speed_mps=1), Drive(for_s=9))), 5)
    assert path.travel(np.array([5.0]))[0, 0] == pytest.approx(0.2)
