"""Motion and measurement model of a box and a position (docs/method.md, section 4 [PIC4SeR])."""

from collections.abc import Sequence

import numpy as np

from common import kalman
from people4d.messages import F64
from services.tracker.interface import Measurement
from services.tracker.motion.motion import SIGMA_START_VELOCITY_MPS

SIGMA_ACCELERATION_MPS2 = 2.0  # standard deviation of a person's acceleration [m/s^2]
SIGMA_POSITION_M = 0.15  # standard deviation of the measured position [m]
SIGMA_CENTRE_PX = 5.0  # standard deviation of the measured centre [px]
SIGMA_ACCELERATION_PXPS2 = 500.0  # standard deviation of the centre's acceleration [px/s^2]
SIGMA_START_CENTRE_PXPS = 300.0  # standard deviation of the centre's initial velocity [px/s]
SIGMA_AREA_RATIO = 0.1  # relative standard deviation of the measured area
# Relative standard deviation of the area's acceleration [1/s^2]
SIGMA_ACCELERATION_AREA_RATIO = 2.0
SIGMA_START_AREA_RATIO_HZ = 1.0  # relative standard deviation of the area's initial velocity [1/s]
SIGMA_ASPECT = 0.1  # standard deviation of the measured aspect ratio (width over height)
SIGMA_ASPECT_DRIFT = 0.2  # drift of the aspect ratio [1/sqrt(s)]


class BoxMotion:
    """State u, v, s, r, x, y, z, du, dv, ds, dx, dy, dz (docs/method.md, section 4).

    u, v is the centre of the box, s its area and r its width over its height. Noise of the area is
    relative: boxes of near people change by more pixels.
    """

    position = slice(4, 7)
    velocity = slice(10, 13)
    _moving = [0, 1, 2, 4, 5, 6]  # noqa: RUF012
    _speeds = [7, 8, 9, 10, 11, 12]  # noqa: RUF012
    _point = np.ix_([4, 5, 6, 10, 11, 12], [4, 5, 6, 10, 11, 12])

    def predict(self, x: F64, P: F64, dt_s: float, noise_factor: float = 1.0) -> tuple[F64, F64]:
        """Move states ahead; areas stay positive, as in SORT."""
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
        """Return R; only the noise of the area varies."""
        z = self.measure(measurements)
        sigmas = np.empty_like(z)
        sigmas[:, :2] = SIGMA_CENTRE_PX
        sigmas[:, 2] = SIGMA_AREA_RATIO * z[:, 2]
        sigmas[:, 3] = SIGMA_ASPECT
        sigmas[:, 4:] = SIGMA_POSITION_M
        return np.asarray(np.square(sigmas)[:, :, None] * np.eye(7))

    def start(self, measurement: Measurement) -> tuple[F64, F64]:
        """Begin with the measurement, with velocities of 0 and their variances."""
        z, R = self.measure([measurement])[0], self.noise([measurement])[0]
        sigmas = [SIGMA_START_CENTRE_PXPS] * 2
        sigmas += [SIGMA_START_AREA_RATIO_HZ * z[2]] + [SIGMA_START_VELOCITY_MPS] * 3
        P = np.zeros((13, 13))
        P[:7, :7] = R
        P[self._speeds, self._speeds] = np.square(sigmas)
        return np.concatenate([z, np.zeros(6)]), P

    def position_and_velocity(self, P: F64) -> F64:
        """Return the block (6x6) of position and velocity of a covariance."""
        return P[self._point]

    def boxes(self, x: F64) -> F64:
        """Return the boxes (Nx4, xyxy, pixels) of N states."""
        width = np.sqrt(x[:, 2] * x[:, 3])
        half = np.column_stack([width, x[:, 2] / width]) / 2
        return np.column_stack([x[:, :2] - half, x[:, :2] + half])

    def _process_noise(self, area_px2: F64, dt_s: float) -> F64:
        ones = np.ones_like(area_px2)
        centre = SIGMA_ACCELERATION_PXPS2 * ones
        area = SIGMA_ACCELERATION_AREA_RATIO * area_px2
        person = SIGMA_ACCELERATION_MPS2 * ones
        sigmas = np.column_stack([centre, centre, area, person, person, person])
        pp, pv, vv = kalman.acceleration_noise(dt_s, sigmas)
        Q = np.zeros((len(area_px2), 13, 13))
        Q[:, self._moving, self._moving] = pp
        Q[:, self._moving, self._speeds] = Q[:, self._speeds, self._moving] = pv
        Q[:, self._speeds, self._speeds] = vv
        Q[:, 3, 3] = SIGMA_ASPECT_DRIFT**2 * dt_s
        return Q
