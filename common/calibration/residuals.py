"""Residuals of people and floors as a function of the poses and clocks of all cameras.

A residual is the difference of a camera's position of a person from the mean of all cameras at the
same time, weighted by their covariances. Floors and directions up have residuals of the same form.
"""

from collections.abc import Mapping
from itertools import combinations

import numpy as np
from scipy.optimize import approx_fprime, least_squares
from scipy.spatial.transform import Rotation

from common.calibration.floor import MeasuredFloor
from common.calibration.groups import Groups
from people4d.messages import F64

ACROSS_SIGMA_M, DEPTH_SIGMA_M, DEPTH_SIGMA_PER_M = (
    0.02,
    0.02,
    0.001,
)  # [m] standard deviations across the ray, and at depth z: s + k z^2
LIMB_ACROSS_SIGMA_M = 0.02  # [m] standard deviation of limb joints across the ray
LIMB_ALONG_SIGMA_M = 1.0  # [m] along the ray, about the torso's distance
BIAS_SIGMA_M = 0.02  # [m] standard deviation of a camera's bias from the mean bias
COMMON_BIAS_SIGMA_M = 0.1  # [m] standard deviation of the mean bias, surface to axis of the body
DRIFT_SIGMA = 1e-4  # standard deviation of the drift of a clock, 100 ppm
SCALE_SIGMA = 0.1  # standard deviation of a scale from 1
COMMON_SCALE_SIGMA = 1e-3  # standard deviation of the mean scale from 1
UP_SIGMA_RAD = 0.007  # [rad] standard deviation of the direction up of a single camera
CORRELATED = 6.0  # number of consecutive positions, at intervals of 0.1 s, that count as one
POSE, CLOCK, BIAS, SCALE = slice(0, 6), slice(6, 8), slice(8, 9), slice(9, 11)
STEP = 1e-6  # step of numeric derivatives
PARAMETERS = 11  # number of parameters of a camera


class Residuals:
    """Residuals of people as a function of the parameters of all cameras."""

    groups: Groups

    def __init__(self, ups: F64) -> None:
        """Args: ups: directions up by the people in each camera (Cx3), optical frames."""
        self._count, self._people_up = len(ups), ups
        self.set_floors({})
        self._free = np.zeros((len(ups), PARAMETERS), np.bool_)
        self._free[1:, POSE] = self._free[1:, CLOCK] = True
        self._free[:, BIAS] = True

    def set_floors(self, floors: Mapping[int, MeasuredFloor]) -> None:
        """Set the floors by number of their camera; they replace the direction up from people."""
        self._floors = dict(floors)
        self._ups, self._up_sigmas = self._people_up.copy(), np.full(self._count, UP_SIGMA_RAD)
        for k, floor in floors.items():
            self._ups[k], self._up_sigmas[k] = floor.up, floor.sigma_rad
        self._height_sigmas = np.array([floor.sigma_m for floor in floors.values()])

    def floor(self, x: F64) -> MeasuredFloor | None:
        """Return the mean floor of all cameras, in the frame of the reference."""
        if not self._floors:
            return None
        ups, heights_m = self._levels(x)
        used = list(self._floors)
        up = _mean(ups[used], self._up_sigmas[used])
        up /= np.linalg.norm(up)
        return MeasuredFloor(
            up=up,
            middle_m=up * _mean(heights_m, self._height_sigmas),
            sigma_m=float((self._height_sigmas**-2).sum() ** -0.5),
            sigma_rad=float((self._up_sigmas[used] ** -2).sum() ** -0.5),
        )

    def floor_differences(self, x: F64) -> dict[int, tuple[float, float]]:
        """Return the difference [m, rad] of each floor from the common one."""
        common = self.floor(x)
        if common is None:
            return {}
        ups, heights_m = self._levels(x)
        apart_m = np.abs(heights_m - common.up @ common.middle_m)
        return {
            k: (float(m), float(np.linalg.norm(ups[k] - common.up)))
            for k, m in zip(self._floors, apart_m, strict=True)
        }

    def _levels(self, x: F64) -> tuple[F64, F64]:
        """Return directions up (Cx3) and heights of floors (F) in the frame of the reference."""
        turns = Rotation.from_rotvec(x[:, :3]).as_matrix()
        ups = np.einsum("cij,cj->ci", turns, self._ups)
        up = _mean(ups, self._up_sigmas)
        middles = [turns[k] @ floor.middle_m + x[k, 3:6] for k, floor in self._floors.items()]
        return ups, np.array(middles).reshape(-1, 3) @ (up / np.linalg.norm(up))

    def _moved(self, x: F64) -> tuple[F64, F64, F64]:
        """Return positions and rays (GxCx3) in the frame of the reference, and sigmas (2xGxC).

        The sigmas are across the ray and along it.
        """
        g = self.groups
        turns = Rotation.from_rotvec(x[:, :3]).as_matrix()
        late_s = x[:, 6] + x[:, 7] * g.times_s[:, None] - g.offsets_s
        points = (g.points_m + g.velocities_mps * late_s[..., None]) * (1 + x[:, [9, 9, 10]])
        distance = np.linalg.norm(points, axis=-1)
        rays = np.einsum("cij,gcj->gci", turns, points / distance[..., None])
        # Errors across the ray grow with the corrected distance. Otherwise smaller distances would
        # lower the cost, and draw all cameras towards the people.
        is_torso = np.arange(len(distance))[:, None] < g.torsos
        across = np.where(is_torso, ACROSS_SIGMA_M, LIMB_ACROSS_SIGMA_M)
        across = across * (1 + x[:, 9]) * (1 + x[:, 8] / distance)
        along = np.maximum(DEPTH_SIGMA_M + DEPTH_SIGMA_PER_M * distance**2, ACROSS_SIGMA_M)
        along = np.where(is_torso, along, LIMB_ALONG_SIGMA_M)
        return rays * (distance + x[:, 8])[..., None] + x[:, 3:6], rays, np.stack([across, along])

    def differences(self, x: F64) -> F64:
        """Return the differences (GxCx3) from the mean position of each person, in sigmas."""
        points, rays, sigmas = self._moved(x)
        across, along = sigmas[..., None]
        has = self.groups.has[..., None]
        lines = rays[..., :, None] * rays[..., None, :]
        inverse = np.eye(3) / across[..., None] ** 2
        inverse = (inverse + lines * (along**-2 - across**-2)[..., None]) * has[..., None]
        weighted = np.einsum("gcij,gcj->gi", inverse, points)
        means = np.linalg.solve(inverse.sum(axis=1), weighted[..., None])[..., 0]
        apart = points - means[:, None]
        on_ray = (apart * rays).sum(axis=-1, keepdims=True)
        return np.asarray((apart / across + rays * on_ray * (1 / along - 1 / across)) * has)

    def residuals(self, x: F64) -> F64:
        """Return whitened differences, followed by the priors."""
        ups, heights_m = self._levels(x)
        known = [
            ((ups - _mean(ups, self._up_sigmas)) / self._up_sigmas[:, None]).ravel(),
            (heights_m - _mean(heights_m, self._height_sigmas)) / self._height_sigmas,
            x[:, 7] / DRIFT_SIGMA,
            (x[:, 8] - x[:, 8].mean()) / BIAS_SIGMA_M,
            x[:, 8].mean(keepdims=True) / COMMON_BIAS_SIGMA_M,
            (x[:, SCALE] / SCALE_SIGMA).ravel(),
            # A common scale is unobservable: all differences shrink with it.
            x[:, SCALE].mean(axis=0, keepdims=True).ravel() / COMMON_SCALE_SIGMA,
        ]
        observed = self.differences(x)[self.groups.has].ravel()
        return np.concatenate([observed, *(np.sqrt(CORRELATED) * k for k in known)])

    def solve(self, start: F64) -> F64:
        """Return the parameters with the smallest residuals."""
        x = start.copy()
        free = self._free

        def of(values: F64) -> F64:
            x[free] = values
            return self.residuals(x)

        found = least_squares(of, start[free], loss="soft_l1", f_scale=2.0, x_scale="jac")
        x[free] = found.x
        return x

    def covariances(self, x: F64) -> F64:
        """Return the covariances (Cx8x8) of pose and clock; zero for the reference."""
        full = self._covariance(x)
        index = np.cumsum(self._free.ravel()).reshape(-1, PARAMETERS) - 1
        result = np.zeros((self._count, 8, 8))
        for k in range(1, self._count):
            result[k] = full[np.ix_(index[k, :8], index[k, :8])]
        return result

    def scales(self, x: F64) -> tuple[F64, F64]:
        """Return the best-fitting changes of scale (Cx2), and their standard deviations."""
        before = self._free.copy()
        self._free[:, SCALE] = True
        try:
            fitted = self.solve(x)
            full = self._covariance(fitted)
            index = np.cumsum(self._free.ravel()).reshape(-1, PARAMETERS) - 1
            sigmas = np.sqrt(np.diag(full).clip(0))[index[:, SCALE]]
        finally:
            self._free = before
        return fitted[:, SCALE], sigmas

    def squares_m2(self, x: F64) -> dict[tuple[int, int], F64]:
        """Return the squared distances of positions by pair of cameras with common people."""
        points, _, _ = self._moved(x)
        pairs = combinations(range(self._count), 2)
        return {
            (a, b): ((points[both, a] - points[both, b]) ** 2).sum(axis=-1)
            for a, b in pairs
            if (both := self.groups.pair(a, b)).any()
        }

    def _covariance(self, x: F64) -> F64:
        free, at = self._free, x.copy()

        def of(values: F64) -> F64:
            at[free] = values
            return self.residuals(at)

        base, jacobian = self.residuals(x), approx_fprime(x[free], of, STEP)
        # Empirical variance of the residuals; consecutive ones are correlated.
        torsos = self.groups.torsos
        count = int(self.groups.has[:torsos].sum())
        variance = max(float(np.median(np.abs(base[: 3 * count])) / 0.6745) ** 2, 0.04)
        variance *= count / (count - torsos)  # degrees of freedom of the means
        size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
        inverse = np.linalg.pinv((jacobian / size).T @ (jacobian / size), hermitian=True)
        return np.asarray(inverse / np.outer(size, size) * variance * CORRELATED)


def turn_of(x: F64) -> F64:
    """Return the rotation (3x3) of a camera's parameters."""
    return np.asarray(Rotation.from_rotvec(x[:3]).as_matrix())


def _mean(values: F64, sigmas: F64) -> F64:
    """Return the weighted mean over the first axis; 0 for an empty axis."""
    weights = sigmas**-2
    return np.asarray(weights @ values / max(float(weights.sum()), 1e-12))
