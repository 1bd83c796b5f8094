"""Yaw of people: filtered from keypoints, or the direction of their velocity."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common import kalman
from common.geometry.transforms import wrap
from people4d.messages import F64
from services.tracker.config import TrackerConfig, YawFilterConfig
from services.tracker.interface import Measurement


@dataclass(frozen=True, slots=True)
class YawState:
    """State of the yaw filter of one track."""

    x: F64  # 2: psi in radians, wrapped, and dpsi in radians a second
    P: F64  # 2x2 covariance


@dataclass(frozen=True, slots=True)
class YawMeasurement:
    """One measured angle."""

    rad: float | None  # [rad] None if there is none
    variance: float  # [rad^2]


States = Sequence[YawState | None]  # one for each track, None: unknown


class VelocityYaw:
    """Yaw of tracks without a state: atan2(v_y, v_x), the direction of the velocity [PIC4SeR].

    A person slower than `speed_min_mps` has no yaw.
    """

    def __init__(self, speed_min_mps: float) -> None:
        self._speed_min_mps = speed_min_mps

    def predict(self, states: States, dt_s: float) -> list[YawState | None]:  # noqa: ARG002
        """Move states ahead by dt_s seconds."""
        return list(states)

    def update(
        self,
        states: States,
        measurements: Sequence[Measurement],  # noqa: ARG002
        velocities_mps: F64,  # noqa: ARG002
    ) -> list[YawState | None]:
        """Update each state with one measurement, which may have no yaw, and a velocity (Nx3)."""
        return list(states)

    def read(self, state: YawState | None, velocity_mps: F64) -> float | None:  # noqa: ARG002
        """Return the yaw (radians) of a track; None if unknown."""
        v_x, v_y = float(velocity_mps[0]), float(velocity_mps[1])
        speed_mps = math.hypot(v_x, v_y)
        slow = speed_mps == 0 or speed_mps < self._speed_min_mps
        return None if slow else wrap(math.atan2(v_y, v_x))


class KeypointYaw(VelocityYaw):
    """A Kalman filter on psi and dpsi, constant velocity, wrapped innovation.

    The first measurement begins the state; without one the state is predicted. Where so configured,
    the direction of the velocity is a second, weaker measurement. Source: docs/method.md, section 6
    [PIC4SeR].
    """

    def __init__(self, config: YawFilterConfig) -> None:
        self._config = config
        self._direction = VelocityYaw(config.walk_speed_min_mps)
        self._H = np.eye(1, 2)

    def predict(self, states: States, dt_s: float) -> list[YawState | None]:
        """Turn each track on at its own rate; the uncertainty grows."""
        known = [state for state in states if state is not None]
        if not known:
            return list(states)
        x, P = kalman.predict(*_stack(known), self._transition(dt_s), self._noise(dt_s))
        moved = iter(_unstack(x, P))
        return [None if state is None else next(moved) for state in states]

    def update(
        self, states: States, measurements: Sequence[Measurement], velocities_mps: F64
    ) -> list[YawState | None]:
        """Update known states, begin those measured for the first time."""
        measured = [YawMeasurement(m.yaw_rad, self._variance(m)) for m in measurements]
        after = self._correct(states, measured)
        variance = self._config.sigma_walk_rad**2
        if variance == math.inf:
            return after
        walking = [YawMeasurement(self._direction.read(None, v), variance) for v in velocities_mps]
        return self._correct(after, walking)

    def _correct(
        self, states: States, measurements: Sequence[YawMeasurement]
    ) -> list[YawState | None]:
        after, known = list(states), list[tuple[int, YawState, YawMeasurement]]()
        for index, (state, measurement) in enumerate(zip(states, measurements, strict=True)):
            if measurement.rad is None or not math.isfinite(measurement.rad):
                continue
            if state is None:
                after[index] = self._start(measurement.rad, measurement.variance)
            else:
                known.append((index, state, measurement))
        if known:
            x, P = _stack([state for _, state, _ in known])
            psi = x[:, :1]
            y = _wrap(np.array([[measurement.rad] for *_, measurement in known]) - psi)
            R = np.array([measurement.variance for *_, measurement in known])
            R = self._damped(y[:, 0], P[:, 0, 0], R)
            corrected = _unstack(*kalman.update(x, P, psi + y, self._H, R[:, None, None]))
            for (index, _, _), state in zip(known, corrected, strict=True):
                after[index] = state
        return after

    def read(self, state: YawState | None, velocity_mps: F64) -> float | None:  # noqa: ARG002
        """Return psi."""
        return None if state is None else wrap(float(state.x[0]))

    def _transition(self, dt_s: float) -> F64:
        """Return F; a rate that decays with time constant tau turns by tau (1 - exp(-dt/tau))."""
        tau_s = self._config.rate_decay_s
        decay = math.exp(-dt_s / tau_s)
        return np.array([[1.0, dt_s if decay == 1 else tau_s * (1 - decay)], [0.0, decay]])

    def _noise(self, dt_s: float) -> F64:
        pp, pv, vv = kalman.acceleration_noise(dt_s, self._config.sigma_acceleration_radps2)
        return np.array([[pp, pv], [pv, vv]])

    def _damped(self, y: F64, variance: F64, R: F64) -> F64:
        """Return R (N), raised where it takes that to keep y within outlier_sigmas of sqrt(S)."""
        return np.maximum(R, np.square(y / self._config.outlier_sigmas) - variance)

    def _start(self, psi_rad: float, variance: float) -> YawState:
        rate = self._config.sigma_start_rate_radps**2
        return YawState(_wrap(np.array([psi_rad, 0.0])), np.diag([variance, rate]))

    def _variance(self, measurement: Measurement) -> float:
        """Return R: one constant, or the variance of the measurement."""
        own_rad = measurement.yaw_sigma_rad if self._config.measured_sigma else None
        return (own_rad or self._config.sigma_measurement_rad) ** 2


def make_yaw(config: TrackerConfig) -> VelocityYaw:
    """Build the configured estimator."""
    if config.yaw == "keypoints":
        return KeypointYaw(config.yaw_filter)
    return VelocityYaw(config.yaw_speed_min_mps if config.yaw == "velocity" else math.inf)


def _wrap(angles_rad: F64) -> F64:
    return np.arctan2(np.sin(angles_rad), np.cos(angles_rad))


def _stack(states: Sequence[YawState]) -> tuple[F64, F64]:
    return np.array([s.x for s in states]), np.array([s.P for s in states])


def _unstack(x: F64, P: F64) -> list[YawState]:
    x = np.column_stack([_wrap(x[:, 0]), x[:, 1]])
    return [YawState(*state) for state in zip(x, P, strict=True)]
