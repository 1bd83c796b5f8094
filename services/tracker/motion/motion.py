"""Motion and measurement models: constant velocity (docs/method.md, section 3 [PIC4SeR])."""

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from common import kalman
from people4d.messages import F64
from services.tracker.config import Sort3dConfig
from services.tracker.interface import Measurement
from services.tracker.strongsort3d.config import StrongSort3dConfig

GATE_SIGMA_M = 0.15  # standard deviation of positions on top of a measured R in gates [m]

# Parts of matrices of position and velocity (6x6), by block.
OF_POSITION = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
OF_VELOCITY = np.eye(6) - OF_POSITION
VELOCITY_TO_POSITION = np.eye(6, k=3)
OF_BOTH = VELOCITY_TO_POSITION + VELOCITY_TO_POSITION.T


def depth_factor(forward_m: npt.ArrayLike, max_depth_m: float) -> F64:
    """Return 1 + x / max_depth, the growth of R with the distance to the camera."""
    return 1.0 + np.maximum(np.asarray(forward_m, np.float64), 0.0) / max_depth_m


def confidence_factor(score: npt.ArrayLike, floor: float) -> F64:
    """Return 1 - c (NSA), not below a floor: a score of 1 would make R 0."""
    return np.maximum(1.0 - np.asarray(score, np.float64), floor)


def measured_noise(
    constant: Callable[[Sequence[Measurement]], F64],
    measurements: Sequence[Measurement],
) -> F64:
    """Return the noise of positions (Nx3x3): the detector's, else the constant."""
    measured = [m.covariance_m2 for m in measurements if m.covariance_m2 is not None]
    R: F64 = np.array(measured).reshape(-1, 3, 3)
    if len(measured) == len(measurements):
        return R
    result = constant(measurements)
    result[[m.covariance_m2 is not None for m in measurements]] = R
    return result


class PositionMotion:
    """State x, y, z and their velocities; measured x, y, z (docs/method.md, section 5)."""

    size = 6
    position = slice(0, 3)
    velocity = slice(3, 6)

    def __init__(self, config: StrongSort3dConfig) -> None:
        self._config = config

    def predict(self, x: F64, P: F64, dt_s: float, noise_factor: float = 1.0) -> tuple[F64, F64]:
        """Move states ahead; the covariance of the process noise is multiplied by a factor."""
        sigma_mps2 = math.sqrt(noise_factor) * self._config.sigma_acceleration_mps2
        pp, pv, vv = kalman.acceleration_noise(dt_s, sigma_mps2)
        F = np.eye(6) + dt_s * VELOCITY_TO_POSITION
        return kalman.predict(x, P, F, pp * OF_POSITION + pv * OF_BOTH + vv * OF_VELOCITY)

    def position_and_velocity(self, P: F64) -> F64:
        """Return their part (6x6) of a covariance."""
        return P

    def measure(self, measurements: Sequence[Measurement]) -> F64:
        """Return the positions."""
        return np.array([m.position_m for m in measurements]).reshape(-1, 3)

    def noise(self, measurements: Sequence[Measurement]) -> F64:
        """Return R of updates: as measured, or grown with depth and shrunk by the score (NSA)."""
        return self._noise(measurements, self._score_noise)

    def gate_noise(self, measurements: Sequence[Measurement]) -> F64:
        """Return R of gates: StrongSORT leaves the score out, and measured R grows by a constant.

        Errors of consecutive frames are similar, so that a track is off by as much as they are.
        """
        added_m2 = GATE_SIGMA_M**2 if self._config.noise == "measured" else 0.0
        return self._noise(measurements, self._depth_noise) + added_m2 * np.eye(3)

    def _score_noise(self, measurements: Sequence[Measurement]) -> F64:
        factor = confidence_factor([m.score for m in measurements], self._config.nsa_floor)
        return factor[:, None, None] * self._depth_noise(measurements)

    def _depth_noise(self, measurements: Sequence[Measurement]) -> F64:
        factor = depth_factor([m.forward_m for m in measurements], self._config.max_depth_m)
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
        """Begin at the measured position, with the measured velocity or 0 and its variance."""
        P = np.eye(6) * self._config.sigma_start_velocity_mps**2
        P[:3, :3] = self.noise([measurement])[0]
        x = np.concatenate([measurement.position_m, np.zeros(3)])
        if measurement.velocity is None:
            return x, P
        return kalman.update_velocity(x, P, *measurement.velocity)


class BoxMotion:
    """State u, v, s, r, x, y, z, du, dv, ds, dx, dy, dz (docs/method.md, section 4).

    u, v is the centre of the box, s its area and r its width over its height. Noise of the area is
    relative to the area, since a near person's box changes by more pixels than a far one's.
    """

    size = 13
    position = slice(4, 7)
    velocity = slice(10, 13)
    _moving = [0, 1, 2, 4, 5, 6]  # noqa: RUF012
    _speeds = [7, 8, 9, 10, 11, 12]  # noqa: RUF012
    _point = np.ix_([4, 5, 6, 10, 11, 12], [4, 5, 6, 10, 11, 12])

    def __init__(self, config: Sort3dConfig) -> None:
        self._config = config

    def predict(self, x: F64, P: F64, dt_s: float, noise_factor: float = 1.0) -> tuple[F64, F64]:
        """Move states ahead; an area that would vanish stops shrinking, as in SORT."""
        x = x.copy()
        x[x[:, 2] + dt_s * x[:, 9] <= 0, 9] = 0.0
        F = np.eye(13)
        F[self._moving, self._speeds] = dt_s
        return kalman.predict(x, P, F, noise_factor * self._process_noise(x[:, 2], dt_s))

    def measure(self, measurements: Sequence[Measurement]) -> F64:
        """Return u, v, s, r, x, y, z."""
        boxes = np.array([m.box_xyxy_px for m in measurements], np.float64).reshape(-1, 4)
        centre, (w, h) = (boxes[:, :2] + boxes[:, 2:]) / 2, (boxes[:, 2:] - boxes[:, :2]).T
        points = np.array([m.position_m for m in measurements]).reshape(-1, 3)
        return np.column_stack([centre, w * h, w / h, points])

    def noise(self, measurements: Sequence[Measurement]) -> F64:
        """Return R, constant but for the area."""
        z = self.measure(measurements)
        sigmas = np.empty_like(z)
        sigmas[:, :2] = self._config.sigma_centre_px
        sigmas[:, 2] = self._config.sigma_area_ratio * z[:, 2]
        sigmas[:, 3] = self._config.sigma_aspect
        sigmas[:, 4:] = self._config.sigma_measurement_m
        R = np.square(sigmas)[:, :, None] * np.eye(7)
        if self._config.noise == "measured":
            constant = R[:, 4:, 4:].copy()
            R[:, 4:, 4:] = measured_noise(lambda _: constant, measurements)
        return R

    def start(self, measurement: Measurement) -> tuple[F64, F64]:
        """Begin with the measurement, with velocities of 0 and their variances."""
        z, R = self.measure([measurement])[0], self.noise([measurement])[0]
        config = self._config
        sigmas = [config.sigma_start_centre_pxps] * 2
        sigmas += [config.sigma_start_area_ratio_hz * z[2]] + [config.sigma_start_velocity_mps] * 3
        P = np.zeros((13, 13))
        P[:7, :7] = R
        P[self._speeds, self._speeds] = np.square(sigmas)
        return np.concatenate([z, np.zeros(6)]), P

    def position_and_velocity(self, P: F64) -> F64:
        """Return their part (6x6) of a covariance."""
        return P[self._point]

    def boxes(self, x: F64) -> F64:
        """Return the boxes (Nx4, xyxy, pixels) of N states."""
        width = np.sqrt(x[:, 2] * x[:, 3])
        half = np.column_stack([width, x[:, 2] / width]) / 2
        return np.column_stack([x[:, :2] - half, x[:, :2] + half])

    def _process_noise(self, area_px2: F64, dt_s: float) -> F64:
        config, ones = self._config, np.ones_like(area_px2)
        centre = config.sigma_acceleration_pxps2 * ones
        area = config.sigma_acceleration_area_ratio * area_px2
        person = config.sigma_acceleration_mps2 * ones
        sigmas = np.column_stack([centre, centre, area, person, person, person])
        pp, pv, vv = kalman.acceleration_noise(dt_s, sigmas)
        Q = np.zeros((len(area_px2), 13, 13))
        Q[:, self._moving, self._moving] = pp
        Q[:, self._moving, self._speeds] = Q[:, self._speeds, self._moving] = pv
        Q[:, self._speeds, self._speeds] = vv
        Q[:, 3, 3] = config.sigma_aspect_drift**2 * dt_s
        return Q


Motion: TypeAlias = PositionMotion | BoxMotion
