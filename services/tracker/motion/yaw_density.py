"""Yaw of tracks by its density on the circle (docs/method.md, section 12)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import wrap, wrap_each
from people4d.messages import F64
from services.tracker.interface import Measurement
from services.tracker.motion.yaw import States, VelocityYaw, measured_rad

# Scale of turns: a turn in dt has a wrapped Cauchy density of scale TURN_RADPS dt. Headings
# persist, with occasional abrupt reversals [rad/s]
TURN_RADPS = 2.0
RATE_GAIN = 0.8  # gain of the turn rate by a change of the yaw
RATE_DECAY_S = 0.3  # time constant of the decay of the turn rate [s]
SIGMA_RAD = 0.35  # standard deviation of a measurement if unknown [rad]
SIGMA_MAX_RAD = 0.5  # maximum standard deviation; larger ones raise the outlier probability [rad]
REVERSED, OUTLIERS = 0.005, 0.003  # probabilities of the opposite angle, and of any other angle
CORRELATION_S = 0.2  # correlation time of errors: frames at shorter intervals count less [s]
SHARE_MIN = 0.5  # minimum probability within 60 deg of a known yaw
BINS = 48  # number of angles
STEP_RAD = 2 * math.pi / BINS
ANGLES = STEP_RAD * np.arange(BINS, dtype=np.float64)
# Bins of the angles before, after and opposite; indices take a third of the time of np.roll
PREVIOUS, NEXT = np.roll(np.arange(BINS), 1), np.roll(np.arange(BINS), -1)
OPPOSITE = np.roll(np.arange(BINS), BINS // 2)
NEAR = np.arange(-BINS // 6, BINS // 6 + 1)  # bins within 60 deg of the mode
DENSITY_MIN = 1e-9  # minimum density of a bin
TURN_MAX_RAD = math.radians(60)  # maximum turn between two frames [rad]
OUTLIERS_MAX = 0.9  # maximum outlier probability
SINCE_MIN_S = 0.05  # minimum interval for a rate [s]
OTHER_VIEW_RAD = math.radians(20)  # minimum angle between the lines of sight of two cameras

# Elements of a state: the most likely angle, the probability within 60 degrees of it, the turn
# rate, the time since the last update, the line of sight of that update, and the density
YAW, SHARE, RATE, SINCE, BEARING = range(5)
DENSITY = slice(5, 5 + BINS)
# State of a track whose yaw was never measured
UNKNOWN: F64 = np.concatenate([[0.0, 0.0, 0.0, 1.0, 0.0], np.full(BINS, 1 / BINS)])


@dataclass(frozen=True, slots=True)
class YawMeasurements:
    """Measured yaws of N people; NaN where unknown."""

    yaw_rad: F64  # N
    sigma_rad: F64  # N
    bearing_rad: F64  # N, direction from the camera


class DensityYaw(VelocityYaw):
    """A histogram filter: one probability for each angle, of any distribution.

    Some measurements are off by half a turn, so two opposite angles may be likely for a while.
    """

    def predict(self, states: States, dt_s: float) -> list[F64 | None]:
        """Turn each density by its decaying rate, and widen it.

        Both are products in the frequency domain.
        """
        after = _stacked(states)
        turn_s = -RATE_DECAY_S * math.expm1(-dt_s / RATE_DECAY_S)
        turned = np.exp(-TURN_RADPS * dt_s - 1j * turn_s * after[:, RATE])
        series = np.fft.rfft(after[:, DENSITY])
        series[:, 1:] *= np.multiply.accumulate(
            np.repeat(turned[:, None], BINS // 2, axis=1), axis=1
        )
        after[:, DENSITY] = np.fft.irfft(series, BINS)
        after[:, RATE] *= math.exp(-dt_s / RATE_DECAY_S)
        after[:, SINCE] += dt_s
        return list(_read(after))

    def update(self, states: States, measurements: Sequence[Measurement]) -> list[F64 | None]:
        """Weigh the angles by the measured yaws."""
        after, yaws = _stacked(states), _yaws(measurements)
        # Errors are correlated in consecutive frames, but independent between cameras.
        is_other = np.abs(wrap_each(yaws.bearing_rad - after[:, BEARING])) > OTHER_VIEW_RAD
        weight = np.where(is_other, 1.0, np.minimum(after[:, SINCE] / CORRELATION_S, 1.0))
        p = likelihood_measured(yaws, np.sqrt(weight))
        predicted = after.copy()
        after[:, DENSITY] *= p ** weight[:, None]
        _read(after)
        is_known = ~np.isnan(yaws.yaw_rad)
        after[is_known, RATE] = self._rates(predicted, after)[is_known]
        after[:, SINCE], after[:, BEARING] = 0.0, _or(yaws.bearing_rad, 0.0)
        return list(after)

    def _rates(self, predicted: F64, after: F64) -> F64:
        """Return turn rates from changes of the yaw; 0 for a change too large to be a turn."""
        step_rad = wrap_each(after[:, YAW] - predicted[:, YAW])
        is_turn = np.abs(step_rad) < TURN_MAX_RAD
        is_turn &= predicted[:, SHARE] >= SHARE_MIN
        since_s = np.maximum(predicted[:, SINCE], SINCE_MIN_S)
        rates = predicted[:, RATE] + RATE_GAIN * step_rad / since_s
        result: F64 = np.where(is_turn, rates, 0.0)
        return result

    def read(self, state: F64 | None, velocity_mps: F64) -> float | None:  # noqa: ARG002
        """Return the most likely angle, unless its probability is too low."""
        if state is None or state[SHARE] < SHARE_MIN:
            return None
        return wrap(float(state[YAW]))


def likelihood_measured(yaws: YawMeasurements, factor: F64) -> F64:
    """Return the likelihoods (NxBINS) of measured yaws, with a factor (N) on their sigmas.

    The measured angle is the true one, the opposite one, or any.
    """
    # A sigma above the maximum is replaced by the maximum and a higher outlier probability.
    limited_rad = np.minimum(yaws.sigma_rad, SIGMA_MAX_RAD)
    other = (np.square(yaws.sigma_rad) - np.square(limited_rad)) / math.pi**2
    outliers = np.minimum(OUTLIERS + other, OUTLIERS_MAX)[:, None]
    sigma_rad = np.maximum(factor * limited_rad, STEP_RAD / 2)[:, None]
    normal = _normal(wrap_each(yaws.yaw_rad[:, None] - ANGLES), sigma_rad)
    near = (1.0 - REVERSED) * normal + REVERSED * normal[:, OPPOSITE]
    p = (1.0 - outliers) * near + outliers / (2 * math.pi)
    return _or(p, 1.0)


def _or(values: F64, other: float) -> F64:
    """Return values, with NaN replaced."""
    return np.where(np.isnan(values), other, values)


def _normal(error: F64, sigma: F64) -> F64:
    result: F64 = np.exp(np.square(error / sigma) / -2) / (math.sqrt(2 * math.pi) * sigma)
    return result


def _yaws(measurements: Sequence[Measurement]) -> YawMeasurements:
    sigmas_rad = [m.yaw_sigma_rad or SIGMA_RAD for m in measurements]
    bearings_rad = [m.bearing_rad for m in measurements]
    return YawMeasurements(
        yaw_rad=np.array([measured_rad(m) for m in measurements]),
        sigma_rad=np.array(sigmas_rad),
        bearing_rad=np.array(bearings_rad, np.float64),
    )


def _stacked(states: States) -> F64:
    return np.array([UNKNOWN if state is None else state for state in states])


def _read(states: F64) -> F64:
    """Normalise the densities of states (Nx53), and set the most likely angles and their shares."""
    density = np.maximum(states[:, DENSITY], DENSITY_MIN)
    density /= density.sum(axis=1, keepdims=True)
    smooth = density + density[:, PREVIOUS] + density[:, NEXT]
    best = smooth.argmax(axis=1)[:, None]
    near = density[np.arange(len(best))[:, None], (best + NEAR) % BINS]
    share = near.sum(axis=1)
    states[:, DENSITY], states[:, SHARE] = density, share
    states[:, YAW] = wrap_each(ANGLES[best[:, 0]] + STEP_RAD * (near @ NEAR) / share)
    return states
