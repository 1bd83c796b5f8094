"""Wheel odometry of a robot with two driven wheels and encoders.

The pose follows from the ticks, the nominal radius and the nominal track (docs/method.md section 7:
dtheta = (right - left) / track). Nominal and true values differ:

- true radius = nominal radius / (1 + scale_error): distances are too large by scale_error;
- true track = nominal track * (1 + track_error): turns are too large by track_error;
- a wheel with slip s turns 1 + s times its rolled distance; s is drawn for each wheel and second,
  so errors are a random walk;
- a tick is the smallest measured step.

The covariance of a pose is the first-order effect of these errors: independent slip in each second,
and constant errors with their values as standard deviations.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import wrap
from lab.camera.base_path import BasePath
from people4d.messages import F64, Odometry

I64 = npt.NDArray[np.int64]
KEY = 0x0D0  # key of these random numbers
SLIP_S = 1.0  # duration of constant slip [s]


@dataclass(frozen=True, kw_only=True)
class WheelModel:
    """Encoders, size and errors of the wheels of the simulated robot."""

    rate_hz: float = 50.0  # rate of readings
    radius_m: float = 0.0325  # nominal radius of a wheel
    track_m: float = 0.30  # nominal distance of the wheels
    ticks_per_turn: int = 4096  # ticks per turn of a wheel
    scale_error: float = 0.01  # relative error of the radius of both wheels
    track_error: float = 0.01  # relative error of the track
    slip: float = 0.02  # standard deviation of the relative slip of a wheel


WHEELS = WheelModel()


def wheel_ticks(
    path: BasePath, duration_s: float, seed: int, wheels: WheelModel = WHEELS
) -> tuple[F64, I64]:
    """Return the times (N) and counts (Nx2, left, right) of wheel encoders; seed: of the slip."""
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
    return time_s, np.floor(distance_m / true_tick_m + 0.5).astype(np.int64)


def tick_m(wheels: WheelModel) -> float:
    """Return the nominal distance of one tick."""
    return 2 * math.pi * wheels.radius_m / wheels.ticks_per_turn


def wheel_odometry(
    path: BasePath, duration_s: float, seed: int, wheels: WheelModel = WHEELS
) -> list[Odometry]:
    """Return the wheel odometry of a robot, one message per reading, from (0, 0, 0).

    Args:
        path: True path.
        duration_s: Duration of the scenario.
        seed: Seed of the slip.
        wheels: Wheels and their errors.
    """
    times_s, ticks = wheel_ticks(path, duration_s, seed, wheels)
    steps_m = np.diff(ticks, axis=0) * tick_m(wheels)
    reckoning = DeadReckoning(wheels)
    odometry = [_message(reckoning, 0.0, 0)]
    for sequence, (left_m, right_m) in enumerate(steps_m.tolist(), 1):
        reckoning.add_step(left_m, right_m)
        odometry.append(_message(reckoning, float(times_s[sequence]), sequence))
    return odometry


class DeadReckoning:
    """Pose and covariance from the steps of two wheels.

    Source:
        docs/method.md section 7 [Park 2021].
    """

    def __init__(self, wheels: WheelModel = WHEELS) -> None:
        self._wheels = wheels
        self.pose = np.zeros(3)  # x, y in metres, heading in radians
        self.twist = np.zeros(3)  # [m/s, rad/s] vx, vy, omega
        self._slip = np.zeros((3, 3))  # covariance from slip
        self._bias = np.zeros((3, 2))  # derivative of the pose by scale and track

    @property
    def covariance(self) -> F64:
        """Covariance of the pose, 3x3."""
        wheels = self._wheels
        bias = self._bias * (wheels.scale_error, wheels.track_error)
        tick_variance = tick_m(wheels) ** 2 / 12
        tick = np.diag([tick_variance, tick_variance, 2 * tick_variance / wheels.track_m**2])
        return np.asarray(self._slip + bias @ bias.T + tick)

    def add_step(self, left_m: float, right_m: float) -> None:
        """Add the distances of both wheels since the last reading."""
        wheels = self._wheels
        forward_m, turn_rad = (left_m + right_m) / 2, (right_m - left_m) / wheels.track_m
        middle_rad = self.pose[2] + turn_rad / 2
        cos, sin = math.cos(middle_rad), math.sin(middle_rad)
        moved = np.array([forward_m * cos, forward_m * sin, turn_rad])
        # Derivatives by the last pose, and by the steps of the left and right wheel
        before = np.array([[1, 0, -moved[1]], [0, 1, moved[0]], [0, 0, 1]])
        side = forward_m / (2 * wheels.track_m)
        by_wheel = np.array(
            [
                [cos / 2 + side * sin, cos / 2 - side * sin],
                [sin / 2 - side * cos, sin / 2 + side * cos],
                [-1 / wheels.track_m, 1 / wheels.track_m],
            ]
        )
        # n steps in a second share one slip: (n step)^2 = n (n step^2), n step^2 for each.
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
