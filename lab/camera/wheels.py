"""Wheel odometry: the path of a robot with two driven wheels, from their encoders.

The wheels count ticks. From the ticks, the nominal radius and the nominal track the robot works out
its pose (docs/method.md section 7: dtheta = (right - left) / track). Nominal and true differ:

- true radius = nominal radius / (1 + scale_error): distances come out larger by scale_error;
- true track = nominal track * (1 + track_error): turns come out larger by track_error, too;
- a wheel that slips by s turns 1 + s times as far as it rolls; s is drawn for each wheel anew
  every second, so that errors add up like a random walk;
- a tick is the smallest step that is measured.

The covariance of a pose says what these errors do to it, to first order: the slips as independent
from second to second, the two constant errors as unknown with their own size as standard deviation.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import wrap
from lab.camera.base_path import BasePath
from lab.camera.plan import CameraPlan, WheelPlan
from people4d.messages import F64, Odometry

I64 = npt.NDArray[np.int64]
KEY = 0x0D0  # sets these random numbers apart from others of the same seed
SLIP_S = 1.0  # that a slip lasts


@dataclass(frozen=True)
class WheelTicks:
    """Readings of the wheel encoders."""

    time_s: F64  # N, when each was read
    ticks: I64  # Nx2, left and right, counted from the first reading


def wheel_ticks(plan: CameraPlan, path: BasePath, duration_s: float, seed: int) -> WheelTicks:
    """Return the counts of the wheel encoders on a path; the seed is that of the slip."""
    wheels = plan.wheels
    time_s: F64 = np.arange(math.floor(duration_s * wheels.rate_hz + 1e-9) + 1) / wheels.rate_hz
    forward_m, turned_rad = np.diff(path.travel(time_s), axis=0).T
    half_track_m = wheels.track_m * (1 + wheels.track_error) / 2
    rolled_m = np.stack(
        [forward_m - turned_rad * half_track_m, forward_m + turned_rad * half_track_m], axis=1
    )
    second = (time_s[:-1] / SLIP_S + 1e-9).astype(np.int64)
    slips = np.random.default_rng([seed, KEY]).standard_normal((int(duration_s / SLIP_S) + 1, 2))
    turned_m = rolled_m * (1 + wheels.slip * slips[second])
    distance_m = np.concatenate([np.zeros((1, 2)), np.cumsum(turned_m, axis=0)])
    true_tick_m = tick_m(wheels) / (1 + wheels.scale_error)
    return WheelTicks(time_s, np.floor(distance_m / true_tick_m + 0.5).astype(np.int64))


def tick_m(wheels: WheelPlan) -> float:
    """Return the nominal distance a wheel rolls in one tick."""
    return 2 * math.pi * wheels.radius_m / wheels.ticks_per_turn


def wheel_odometry(
    plan: CameraPlan, path: BasePath, duration_s: float, seed: int
) -> list[Odometry]:
    """Return the odometry of a robot from its wheels, a message a reading; it begins at (0, 0, 0).

    Args:
        plan: The wheels and their errors.
        path: The true path.
        duration_s: Length of the scenario.
        seed: Of the slip.
    """
    readings = wheel_ticks(plan, path, duration_s, seed)
    steps_m = np.diff(readings.ticks, axis=0) * tick_m(plan.wheels)
    reckoning = DeadReckoning(plan.wheels)
    odometry = [_message(reckoning, 0.0, 0)]
    for sequence, (left_m, right_m) in enumerate(steps_m.tolist(), 1):
        reckoning.step(left_m, right_m)
        odometry.append(_message(reckoning, float(readings.time_s[sequence]), sequence))
    return odometry


class DeadReckoning:
    """A pose from the steps of two wheels, and its covariance.

    Source:
        docs/method.md section 7 [Park 2021].
    """

    def __init__(self, wheels: WheelPlan) -> None:
        self._wheels = wheels
        self.pose = np.zeros(3)  # x, y in metres, heading in radians
        self.twist = np.zeros(3)  # [m/s, rad/s] vx, vy, omega
        self._slip = np.zeros((3, 3))  # covariance that slip has caused
        self._bias = np.zeros((3, 2))  # how the pose changes with the scale and with the track

    @property
    def covariance(self) -> F64:
        """Of the pose, 3x3."""
        wheels = self._wheels
        bias = self._bias * (wheels.scale_error, wheels.track_error)
        tick_variance = tick_m(wheels) ** 2 / 12
        tick = np.diag([tick_variance, tick_variance, 2 * tick_variance / wheels.track_m**2])
        return np.asarray(self._slip + bias @ bias.T + tick)

    def step(self, left_m: float, right_m: float) -> None:
        """Take in how far the wheels turned since the last reading."""
        wheels = self._wheels
        forward_m, turn_rad = (left_m + right_m) / 2, (right_m - left_m) / wheels.track_m
        middle_rad = self.pose[2] + turn_rad / 2
        cos, sin = math.cos(middle_rad), math.sin(middle_rad)
        moved = np.array([forward_m * cos, forward_m * sin, turn_rad])
        # By the pose before, and by the steps of the left and of the right wheel.
        before = np.array([[1, 0, -moved[1]], [0, 1, moved[0]], [0, 0, 1]])
        side = forward_m / (2 * wheels.track_m)
        by_wheel = np.array(
            [
                [cos / 2 + side * sin, cos / 2 - side * sin],
                [sin / 2 - side * cos, sin / 2 + side * cos],
                [-1 / wheels.track_m, 1 / wheels.track_m],
            ]
        )
        # n steps of one second share their slip, and (n step)^2 = n (n step^2): so much a step.
        variance = wheels.slip**2 * np.array([left_m**2, right_m**2]) * wheels.rate_hz * SLIP_S
        self._slip = before @ self._slip @ before.T + by_wheel * variance @ by_wheel.T
        by_scale = by_wheel @ (left_m, right_m)
        by_track = by_wheel @ (-turn_rad * wheels.track_m / 2, turn_rad * wheels.track_m / 2)
        self._bias = before @ self._bias + np.stack([by_scale, by_track], axis=1)
        self.pose = self.pose + moved
        self.twist = np.array([forward_m, 0.0, turn_rad]) * wheels.rate_hz


def _message(reckoning: DeadReckoning, time_s: float, sequence: int) -> Odometry:
    x_m, y_m, theta_rad = reckoning.pose.tolist()
    return Odometry(
        stamp_ns=round(time_s * 1e9),
        sequence=sequence,
        frame_id="odom",
        child_frame_id="base_link",
        x_m=x_m,
        y_m=y_m,
        theta_rad=wrap(theta_rad),
        covariance=reckoning.covariance,
        twist=reckoning.twist,
    )
