"""Yaw of people: filtered from keypoints, or the direction of their velocity."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from common import kalman
from common.geometry.transforms import wrap
from people4d.messages import F64
from services.tracker.config import TrackerConfig, YawFilterConfig
from services.tracker.interface import Measurement


class YawState(NamedTuple):
    """State of the yaw filter of one track: numbers, since arrays of two take much longer."""

    psi_rad: float  # wrapped
    rate_radps: float  # dpsi
    psi_variance: float  # the covariance of both
    cross: float
    rate_variance: float
    agreement_s: float = 0.0  # [s] of measurements that agree, less that of reversed ones
    since_s: float = 0.0  # [s] since the last measurement from keypoints

    def check(self) -> None:
        """Check the state of a checkpoint.

        Raises:
            ValueError: It is out of range.
        """
        p, c, v = self.psi_variance, self.cross, self.rate_variance
        in_range = all(abs(number) <= YAW_STATE_MAX for number in self)
        times = self.agreement_s >= 0.0 and self.since_s >= 0.0
        if not (in_range and times and p > 0.0 and c * c <= p * v * 1.001):
            raise ValueError("expected yaws in range with a positive covariance")


UNIFORM_RAD = math.pi / math.sqrt(3)  # standard deviation of an angle about which nothing is known
REVERSED_RAD = math.radians(120)  # a measurement farther off is taken as reversed
YAW_STATE_MAX = 1e12  # of a checkpoint; its largest numbers are seconds and variances
STEPS_MAX = 1000  # of one prediction; a yaw that was not measured for so long is unknown
BEHIND_COS = 0.5  # a heading within 60 deg of the line of sight shows the back
# Weights of a direction of walking against measurements: people step back, too; but networks take
# backs for fronts more often than people step back from a camera
WALKING, WALKING_AWAY = 0.5, 2.0
STEP_MAX_S = 0.2  # [s] one measurement counts for no longer

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
        velocities_mps: Iterable[F64],  # noqa: ARG002
    ) -> list[YawState | None]:
        """Update each state with one measurement, which may have no yaw, and a velocity (3)."""
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

    def predict(self, states: States, dt_s: float) -> list[YawState | None]:
        """Turn each track on at its own rate; the uncertainty grows."""
        config, after = self._config, list(states)
        steps = min(max(math.ceil(dt_s / config.acceleration_s), 1), STEPS_MAX)
        dt_s /= steps
        step = self._turn_s(dt_s), math.exp(-dt_s / config.rate_decay_s)
        pp, pv, vv = kalman.acceleration_noise(dt_s, config.sigma_acceleration_radps2)
        noise = pp, pv, vv
        for _ in range(steps):
            after = [
                None if state is None else predicted(state, dt_s, step, noise) for state in after
            ]
        return after

    def update(
        self, states: States, measurements: Sequence[Measurement], velocities_mps: Iterable[F64]
    ) -> list[YawState | None]:
        """Update known states, begin those measured for the first time."""
        after = [self._measured(state, m) for state, m in zip(states, measurements, strict=True)]
        if self._config.sigma_walk_rad == math.inf:
            return after
        return [
            self._walked(state, self._direction.read(None, v), before, m)
            for state, v, before, m in zip(after, velocities_mps, states, measurements, strict=True)
        ]

    def _measured(self, state: YawState | None, measurement: Measurement) -> YawState | None:
        """Return a state updated with an angle from keypoints, if there is one.

        A reversed angle is left out until reversed ones have outlasted those that agree; then the
        state begins anew. One of a person seen from behind is right, and outlasts all others.
        Agreement is forgotten while there are no measurements.
        """
        measured_rad, variance = measurement.yaw_rad, self._variance(measurement)
        if measured_rad is None or not math.isfinite(measured_rad):
            return state
        least_s = self._config.reversal_s if is_from_behind(measured_rad, measurement) else 0.0
        if state is None:
            return self._start(measured_rad, variance, least_s)
        step_s = min(state.since_s, STEP_MAX_S)
        agreement_s = max(state.agreement_s - (state.since_s - step_s), 0.0)
        step_s *= trust(measurement)
        if self._is_reversed(state, measured_rad):
            if agreement_s < step_s or least_s > 0:
                return self._start(measured_rad, variance, least_s)
            return state._replace(agreement_s=agreement_s - step_s, since_s=0.0)
        after = self._correct(state, measured_rad, variance)
        agreement_s = max(min(agreement_s + step_s, self._config.reversal_s), least_s)
        return after and after._replace(agreement_s=agreement_s, since_s=0.0)

    def _walked(
        self,
        state: YawState | None,
        direction_rad: float | None,
        before: YawState | None,
        measurement: Measurement,
    ) -> YawState | None:
        """Return a state updated with a direction of walking, if there is one.

        In frames with a measurement a reversed one takes away agreement, until the state turns; one
        that leads away from the camera adds to it, too.
        """
        variance = self._config.sigma_walk_rad**2
        if state is None or before is None or direction_rad is None:
            return self._correct(state, direction_rad, variance)
        leaves = is_from_behind(direction_rad, measurement)
        step_s = min(max(before.since_s - state.since_s, 0.0), STEP_MAX_S)
        step_s *= WALKING_AWAY if leaves else WALKING
        if not self._is_reversed(state, direction_rad):
            after = self._correct(state, direction_rad, variance)
            agreement_s = state.agreement_s + step_s * leaves
            limited_s = max(min(agreement_s, self._config.reversal_s), state.agreement_s)
            return after and after._replace(agreement_s=limited_s)
        agreement_s = state.agreement_s - step_s
        if agreement_s >= 0:
            return state._replace(agreement_s=agreement_s)
        return self._start(state.psi_rad + math.pi, state.psi_variance, step_s * leaves)

    def _correct(
        self, state: YawState | None, measured_rad: float | None, variance: float
    ) -> YawState | None:
        """Return a state updated with an angle, if there is one that is not reversed.

        R is raised where it takes that to keep the innovation within outlier_sigmas of sqrt(S).
        """
        if measured_rad is None:
            return state
        if state is None:
            return self._start(measured_rad, variance)
        if self._is_reversed(state, measured_rad):
            return state
        y = wrap(measured_rad - state.psi_rad)
        damped = (y / self._config.outlier_sigmas) ** 2 - state.psi_variance
        return corrected(state, y, max(variance, damped))

    def _is_reversed(self, state: YawState, measured_rad: float) -> bool:
        y = wrap(measured_rad - state.psi_rad)
        return self._config.reversal_s > 0 and abs(y) > REVERSED_RAD

    def read(self, state: YawState | None, velocity_mps: F64) -> float | None:  # noqa: ARG002
        """Return psi, unless too much time without a measurement has made it unknown."""
        limit = self._config.sigma_unknown_rad**2
        return None if state is None or state.psi_variance > limit else wrap(state.psi_rad)

    def _turn_s(self, dt_s: float) -> float:
        """Return the turn at a rate of 1 that decays with tau: tau (1 - exp(-dt / tau))."""
        tau_s = self._config.rate_decay_s
        return dt_s if tau_s == math.inf else -tau_s * math.expm1(-dt_s / tau_s)

    def _start(self, psi_rad: float, variance: float, agreement_s: float = 0.0) -> YawState:
        rate = self._config.sigma_start_rate_radps**2
        return YawState(wrap(psi_rad), 0.0, variance, 0.0, rate, agreement_s)

    def _variance(self, measurement: Measurement) -> float:
        """Return R: one constant, or the variance of the measurement, limited."""
        config, own_rad = self._config, measurement.yaw_sigma_rad
        if not config.measured_sigma or own_rad is None:
            return config.sigma_measurement_rad**2
        return min(own_rad, config.sigma_max_rad) ** 2


def trust(measurement: Measurement) -> float:
    """Return the weight (0 to 1) of a measurement against reversed ones; a guess has none."""
    sigma_rad = measurement.yaw_sigma_rad or 0.0
    return max(1.0 - (sigma_rad / UNIFORM_RAD) ** 2, 0.0)


def is_from_behind(direction_rad: float, measurement: Measurement) -> bool:
    """Check that a direction leads away from the camera: a person who faces it shows the back."""
    bearing_rad = measurement.bearing_rad
    return bearing_rad is not None and math.cos(direction_rad - bearing_rad) > BEHIND_COS


def predicted(
    state: YawState, dt_s: float, F: tuple[float, float], noise: tuple[float, float, float]
) -> YawState:
    """Return a state moved ahead by [1 turn; 0 decay], of which F has two, and elements of Q."""
    psi, rate, p, c, v, agreement_s, since_s = state
    (turn_s, decay), (pp, pv, vv) = F, noise
    cross = decay * (c + turn_s * v) + pv
    p += turn_s * (2.0 * c + turn_s * v) + pp
    psi, rate, v = wrap(psi + turn_s * rate), decay * rate, decay * decay * v + vv
    return YawState(psi, rate, p, cross, v, agreement_s, since_s + dt_s)


def corrected(state: YawState, y: float, variance: float) -> YawState:
    """Return a state updated with an innovation y of psi with variance R, in Joseph's form."""
    psi, rate, p, c, v, agreement_s, since_s = state
    k, m = p / (p + variance), c / (p + variance)
    cross = (1.0 - k) * (c - m * p) + k * m * variance
    p_after = (1.0 - k) ** 2 * p + k * k * variance
    v_after = v - 2.0 * m * c + m * m * (p + variance)
    psi, rate = wrap(psi + k * y), rate + m * y
    return YawState(psi, rate, p_after, cross, v_after, agreement_s, since_s)


def make_yaw(config: TrackerConfig) -> VelocityYaw:
    """Build the configured estimator."""
    if config.yaw == "keypoints":
        return KeypointYaw(config.yaw_filter)
    return VelocityYaw(config.yaw_speed_min_mps if config.yaw == "velocity" else math.inf)
