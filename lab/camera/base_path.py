"""Path of the robot: a base that drives on the floor and carries the camera.

Ramps join forward speed and turn rate of the plan's sections continuously. A ramp is half a cosine,
centred on the boundary of two sections, which keeps distance and angle of the plan. The base starts
at the speed of its first section and stands after the last one.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from, wrap
from lab.camera.plan import CameraPlan, Drive
from people4d.messages import F64

ACCELERATION_MPS2 = 0.5  # maximum acceleration of an indoor robot [m/s^2]
TURN_ACCELERATION_RADPS2 = 1.5
GRID_S = 0.005  # step of the integration [s]
MARGIN_S = 2.0  # duration of known poses before the start and after the end [s]
FOREVER_S = 1e9  # duration longer than any scenario [s]


@dataclass(frozen=True)
class SpeedProfile:
    """Speed over time: a first value and N ramps; distances are its exact integral."""

    first: float  # speed before all ramps
    steps: F64  # N, changes of the speed
    middles_s: F64  # N, times of the middles of the ramps
    lengths_s: F64  # N, durations of the ramps, > 0

    def speed(self, t_s: F64) -> F64:
        """Return the speed at times."""
        speed = np.full(len(t_s), self.first, np.float64)
        for step, middle_s, length_s in self._ramps():
            speed += step * (1 - np.cos(np.pi * _done(t_s, middle_s, length_s))) / 2
        return speed

    def distance(self, t_s: F64) -> F64:
        """Return the distance from time 0, signed."""
        return self._integral(t_s) - self._integral(np.zeros(1))

    def _integral(self, t_s: F64) -> F64:
        """Return an integral of the speed: a ramp has the distance of a jump at its middle."""
        integral = self.first * t_s
        for step, middle_s, length_s in self._ramps():
            done = _done(t_s, middle_s, length_s)
            within = (done - np.sin(np.pi * done) / np.pi) / 2 * length_s
            integral += step * (within + np.maximum(t_s - middle_s - length_s / 2, 0))
        return integral

    def _ramps(self) -> Iterator[tuple[float, float, float]]:
        return zip(self.steps, self.middles_s, self.lengths_s, strict=True)


def _done(t_s: F64, middle_s: float, length_s: float) -> F64:
    return np.asarray(np.clip((t_s - middle_s) / length_s + 0.5, 0, 1))


class BasePath:
    """Pose of the base and its camera, from MARGIN_S before a scenario to MARGIN_S after it."""

    def __init__(self, plan: CameraPlan, duration_s: float) -> None:
        drives = _stops(plan.drive, duration_s)
        self._forward = _profile(drives, [d.speed_mps for d in drives], ACCELERATION_MPS2)
        turns = [math.radians(d.turn_dps) for d in drives]
        self._turn = _profile(drives, turns, TURN_ACCELERATION_RADPS2)
        self._yaw_rad = math.radians(plan.yaw_deg)
        self._position = _integrate(self._forward, self._turn, self._yaw_rad, duration_s)
        self._start_m = np.array(plan.at[:2]) - self._position(0.0)
        roll_rad, pitch_rad = math.radians(plan.roll_deg), math.radians(plan.pitch_deg)
        tilt = rotation_from_rpy(roll_rad, pitch_rad, 0.0)
        mount = transform_from((0.0, 0.0, plan.at[2]), tilt)
        self.base_from_optical: F64 = mount @ LINK_FROM_OPTICAL  # 4x4, the camera on the base

    def position(self, t_s: float) -> F64:
        """Return x and y [m], frame: map; faster than the whole pose."""
        return np.asarray(self._start_m + self._position(t_s))

    def pose(self, t_s: float) -> tuple[float, float, float]:
        """Return x and y [m] and the yaw in (-pi, pi], frame: map."""
        x, y = self.position(t_s)
        turned_rad = float(self.travel(np.array([t_s]))[0, 1])
        return float(x), float(y), wrap(self._yaw_rad + turned_rad)

    def twist(self, t_s: float) -> tuple[float, float]:
        """Return the forward speed [m/s] and the turn rate [rad/s], counter-clockwise."""
        time_s = np.array([t_s])
        return float(self._forward.speed(time_s)[0]), float(self._turn.speed(time_s)[0])

    def travel(self, t_s: F64) -> F64:
        """Return the travel since time 0 at N times: Nx2, distance [m] and turn [rad]."""
        return np.stack([self._forward.distance(t_s), self._turn.distance(t_s)], axis=1)

    def map_from_base(self, t_s: float) -> F64:
        """Return the pose of the base on the floor, 4x4."""
        x, y, theta = self.pose(t_s)
        return transform_from((x, y, 0.0), rotation_from_rpy(0.0, 0.0, theta))

    def map_from_optical(self, t_s: float) -> F64:
        """Return the pose of the camera's optical frame, 4x4."""
        return np.asarray(self.map_from_base(t_s) @ self.base_from_optical)


def _stops(drives: tuple[Drive, ...], duration_s: float) -> tuple[Drive, ...]:
    """Append a stop to the sections if the scenario is longer."""
    end_s = sum(drive.for_s for drive in drives)
    return drives if drives and end_s >= duration_s else (*drives, Drive(for_s=FOREVER_S))


def _profile(drives: tuple[Drive, ...], speeds: list[float], limit: float) -> SpeedProfile:
    """Join speeds by ramps with the maximum acceleration, not longer than both sections."""
    steps = np.diff(speeds)
    stretches_s = np.array([drive.for_s for drive in drives])
    steepest_s = np.pi / 2 * np.abs(steps) / limit  # the slope of half a cosine is at most pi/2
    room_s = np.minimum(stretches_s[:-1], stretches_s[1:])
    return SpeedProfile(
        first=speeds[0],
        steps=steps,
        middles_s=np.cumsum(stretches_s)[:-1],
        lengths_s=np.maximum(np.minimum(steepest_s, room_s), 1e-6),
    )


def _integrate(
    forward: SpeedProfile, turn: SpeedProfile, yaw_rad: float, duration_s: float
) -> CubicHermiteSpline:
    """Return the relative position: arcs over steps of the grid, with cubic interpolation."""
    count = math.ceil((duration_s + 2 * MARGIN_S) / GRID_S)
    t_s = np.linspace(-MARGIN_S, count * GRID_S - MARGIN_S, count + 1)
    heading = yaw_rad + turn.distance(t_s)
    middle = (heading[1:] + heading[:-1]) / 2
    half_turn = np.diff(heading) / 2
    # Ratio of chord to arc: sin(half the turn) / half the turn
    chord = np.diff(forward.distance(t_s)) * np.sinc(half_turn / np.pi)
    steps = chord[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    positions = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return CubicHermiteSpline(t_s, positions, forward.speed(t_s)[:, None] * direction)
