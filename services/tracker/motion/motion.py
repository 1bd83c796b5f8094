"""Motion and measurement models: constant velocity (docs/method.md, section 3 [PIC4SeR])."""

import math
from collections.abc import Callable, Sequence
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from common import kalman
from people4d.messages import F64
from services.tracker.interface import Measurement

SIGMA_START_VELOCITY_MPS = 2.0  # standard deviation of the velocity of a new track [m/s]
MAX_DEPTH_M = 5.0  # depth at which the noise doubles: R <- (1 + x / max_depth) R (4.11) [m]
SCORE_FLOOR = 0.05  # minimum factor of the noise in R <- (1 - score) R (3.4)
GATE_SIGMA_M = 0.15  # standard deviation added to a measured R in gates [m]

# Blocks of matrices of position and velocity (6x6)
OF_POSITION = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
OF_VELOCITY = np.eye(6) - OF_POSITION
VELOCITY_TO_POSITION = np.eye(6, k=3)
OF_BOTH = VELOCITY_TO_POSITION + VELOCITY_TO_POSITION.T


def depth_factor(forward_m: npt.ArrayLike) -> F64:
    """Return 1 + x / max_depth, the growth of R with the distance to the camera."""
    return 1.0 + np.maximum(np.asarray(forward_m, np.float64), 0.0) / MAX_DEPTH_M


def confidence_factor(score: npt.ArrayLike) -> F64:
    """Return 1 - c (NSA), not below a floor: a score of 1 would make R 0."""
    return np.maximum(1.0 - np.asarray(score, np.float64), SCORE_FLOOR)


def measured_noise(
    constant: Callable[[Sequence[Measurement]], F64],
    measurements: Sequence[Measurement],
) -> F64:
    """Return the noise of positions (Nx3x3): measured, else constant."""
    measured = [m.covariance_m2 for m in measurements if m.covariance_m2 is not None]
    R: F64 = np.array(measured).reshape(-1, 3, 3)
    if len(measured) == len(measurements):
        return R
    result = constant(measurements)
    result[[m.covariance_m2 is not None for m in measurements]] = R
    return result


class Motion(Protocol):
    """A model of the motion of a track."""

    position: slice  # elements of the position in a state
    velocity: slice  # elements of the velocity in a state

    def predict(self, x: F64, P: F64, dt_s: float, noise_factor: float = 1.0) -> tuple[F64, F64]:
        """Move states ahead; the covariance of the process noise is multiplied by a factor."""

    def measure(self, measurements: Sequence[Measurement]) -> F64:
        """Return the measured vectors."""

    def noise(self, measurements: Sequence[Measurement]) -> F64:
        """Return R of updates."""

    def start(self, measurement: Measurement) -> tuple[F64, F64]:
        """Return the state and covariance of a new track."""

    def position_and_velocity(self, P: F64) -> F64:
        """Return the block (6x6) of position and velocity of a covariance."""


class PositionNoise(Protocol):
    """Parameters of process and measurement noise."""

    @property
    def sigma_acceleration_mps2(self) -> float:
        """Standard deviation of the acceleration."""

    @property
    def sigma_measurement_m(self) -> float:
        """Standard deviation of a position without a measured covariance."""

    @property
    def noise(self) -> Literal["constant", "measured"]:
        """Source of R: the detection's covariance if known, or always a constant."""


class PositionMotion:
    """State x, y, z and their velocities; measured x, y, z (docs/method.md, section 5)."""

    position = slice(0, 3)
    velocity = slice(3, 6)

    def __init__(self, config: PositionNoise) -> None:
        self._config = config

    def predict(self, x: F64, P: F64, dt_s: float, noise_factor: float = 1.0) -> tuple[F64, F64]:
        """Move states ahead; the covariance of the process noise is multiplied by a factor."""
        sigma_mps2 = math.sqrt(noise_factor) * self._config.sigma_acceleration_mps2
        pp, pv, vv = kalman.acceleration_noise(dt_s, sigma_mps2)
        F = np.eye(6) + dt_s * VELOCITY_TO_POSITION
        return kalman.predict(x, P, F, pp * OF_POSITION + pv * OF_BOTH + vv * OF_VELOCITY)

    def position_and_velocity(self, P: F64) -> F64:
        """Return the block (6x6) of position and velocity of a covariance."""
        return P

    def measure(self, measurements: Sequence[Measurement]) -> F64:
        """Return the positions."""
        return np.array([m.position_m for m in measurements]).reshape(-1, 3)

    def noise(self, measurements: Sequence[Measurement]) -> F64:
        """Return R of updates: measured, or scaled by depth and score (NSA)."""
        return self._noise(measurements, self._score_noise)

    def gate_noise(self, measurements: Sequence[Measurement]) -> F64:
        """Return R of gates: without the score, as in StrongSORT; a constant adds to measured R.

        Errors of consecutive frames are similar, so a track has the same error as its detections.
        """
        added_m2 = GATE_SIGMA_M**2 if self._config.noise == "measured" else 0.0
        return self._noise(measurements, self._depth_noise) + added_m2 * np.eye(3)

    def _score_noise(self, measurements: Sequence[Measurement]) -> F64:
        factor = confidence_factor([m.score for m in measurements])
        return factor[:, None, None] * self._depth_noise(measurements)

    def _depth_noise(self, measurements: Sequence[Measurement]) -> F64:
        factor = depth_factor([m.forward_m for m in measurements])
        variance = self._config.sigma_measurement_m**2 * factor
        return variance[:, None, None] * np.eye(3)

    def _noise(
        self,
        measurements: Sequence[Measurement],
        constant: Callable[[Sequence[Measurement]], F64],
    ) -> F64:
        if self._config.noise == "measured":
            R = measured_noise(constant, measurements)
        else:
            R = constant(measurements)
        for R_k, measurement in zip(R, measurements, strict=True):
            if measurement.added_covariance_m2 is not None:
                R_k += measurement.added_covariance_m2
        return R

    def start(self, measurement: Measurement) -> tuple[F64, F64]:
        """Begin at the measured position, at rest with the variance of a new velocity."""
        P = np.eye(6) * SIGMA_START_VELOCITY_MPS**2
        P[:3, :3] = self.noise([measurement])[0]
        return np.concatenate([measurement.position_m, np.zeros(3)]), P
