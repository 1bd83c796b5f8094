"""Joint least squares over the poses and clocks of all cameras, with covariance.

Unknown of each camera but the reference: rotation and translation, offset and drift of its clock.
Unknown of each camera: by how much positions lie before or behind the person (bias along the ray).
A residual is the difference of a camera's position of a person from the mean of all cameras at that
time, weighted by their covariances, or that of the directions up that two cameras see.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from common.calibration.graph import Pair
from common.calibration.groups import Groups, find_groups
from common.calibration.level_paths import LevelPaths
from common.calibration.pairs import LevelPose
from people4d.errors import CalibrationError
from people4d.messages import F64

GATES_M = (0.45, 0.4, 0.35)  # of two positions of one person, by round
ACROSS_SIGMA_M, DEPTH_SIGMA_M, DEPTH_SIGMA_PER_M = 0.02, 0.02, 0.001  # at depth z: s + k z^2
LIMB_ACROSS_SIGMA_M = 0.02
LIMB_ALONG_SIGMA_M = 1.0  # of joints at the distance of the torso, which is not theirs
BIAS_SIGMA_M = 0.02  # of the cameras about their mean, which all have by one estimator
COMMON_BIAS_SIGMA_M = 0.1  # of that mean: the surface lies before the axis of the body
DRIFT_SIGMA = 1e-4  # 100 ppm
SCALE_SIGMA = 0.1
COMMON_SCALE_SIGMA = 1e-3
UP_SIGMA_RAD = 0.007  # of the direction up that each camera sees by itself
CORRELATED = 6.0  # consecutive positions, 0.1 s apart, that count as one
POSE, CLOCK, BIAS, SCALE = slice(0, 6), slice(6, 8), slice(8, 9), slice(9, 11)
STEP = 1e-6  # of derivatives
PARAMETERS = 11  # of a camera


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Pose of a camera's optical frame in that of the reference, and its clock."""

    matrix: F64  # 4x4, reference_from_camera
    offset_s: float  # its clock minus the reference's, in the middle of the time
    drift: float  # growth of that offset in a second
    bias_m: float  # added to the distance of every position
    covariance: F64  # 8x8: rotation [rad], translation [m], offset [s], drift
    scales: tuple[float, float]  # across and along the axis that fit best, 1 if right
    scale_sigmas: tuple[float, float]

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the position, along its worst direction."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.covariance[3:6, 3:6])[-1], 0.0)))

    @property
    def sigma_rad(self) -> float:
        """Standard deviation of the rotation, about its worst axis."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.covariance[:3, :3])[-1], 0.0)))

    @property
    def sigma_s(self) -> float:
        """Standard deviation of the offset."""
        return float(np.sqrt(max(self.covariance[6, 6], 0.0)))


@dataclass(frozen=True)
class AdjustmentResult:
    """Poses of all cameras, and what is left of the differences."""

    poses: Mapping[str, CameraPose]
    pair_rms_m: Mapping[Pair, float]
    pair_seconds: Mapping[Pair, float]  # in which both saw a person
    rms_m: float


def adjust(
    cameras: Mapping[str, LevelPaths], first: Mapping[str, LevelPose], reference: str
) -> AdjustmentResult:
    """Return poses that bring the people of all cameras together.

    Args:
        cameras: Paths by name; of all in `first`.
        first: Poses to begin with, in the level frame of the reference.
        reference: Camera that is the origin of poses and clocks.

    Raises:
        CalibrationError: No two cameras have positions of one person.
    """
    names = [reference, *(name for name in first if name != reference)]
    level = {name: cameras[name].level_from_optical for name in names}
    start = np.zeros((len(names), PARAMETERS))
    for k, name in enumerate(names):
        rotation = level[reference].T @ first[name].rotation @ level[name]
        start[k, :3] = Rotation.from_matrix(rotation).as_rotvec()
        start[k, 3:6] = level[reference].T @ first[name].translation_m
        start[k, 6] = first[name].offset_s
    ends = [step for p in cameras[reference].paths for step in (p.first, p.last)]
    middle = (min(ends) + max(ends)) // 2
    problem = _Problem(len(names), np.array([level[name][2] for name in names]))
    poses = dict(first)
    for gate_m in GATES_M:
        problem.groups = find_groups([cameras[name] for name in names], poses, gate_m, middle)
        absent = [name for k, name in enumerate(names) if not problem.groups.has[:, k].any()]
        if absent:
            apart = ", ".join(absent)
            raise CalibrationError(
                f"people before {apart} are not where the other cameras have them",
                "Depth or intrinsics of a camera are wrong, or it moved.",
            )
        start = problem.solve(start)
        poses = {
            name: _level_pose(start[k], level[reference], level[name])
            for k, name in enumerate(names)
        }
    covariance = problem.covariance(start)
    scaled, scale_sigmas = problem.scales(start)
    squares = problem.squares_m2(start)
    total = sum(len(s) for s in squares.values())
    steps_s = problem.groups.times_s
    return AdjustmentResult(
        poses={
            name: CameraPose(
                matrix=_matrix(start[k]),
                offset_s=float(start[k, 6]),
                drift=float(start[k, 7]),
                bias_m=float(start[k, 8]),
                covariance=covariance[k],
                scales=(1 + float(scaled[k, 0]), 1 + float(scaled[k, 1])),
                scale_sigmas=(float(scale_sigmas[k, 0]), float(scale_sigmas[k, 1])),
            )
            for k, name in enumerate(names)
        },
        pair_rms_m={
            (names[i], names[j]): float(np.sqrt(s.mean())) for (i, j), s in squares.items()
        },
        pair_seconds={
            (names[i], names[j]): len(np.unique(steps_s[problem.groups.pair(i, j)]))
            * problem.groups.step_s
            for i, j in squares
        },
        rms_m=float(np.sqrt(sum(s.sum() for s in squares.values()) / max(total, 1))),
    )


class _Problem:
    """Residuals of people as a function of the parameters of all cameras."""

    groups: Groups

    def __init__(self, count: int, up: F64) -> None:
        self._count, self._up = count, up
        self._free = np.zeros((count, PARAMETERS), np.bool_)
        self._free[1:, POSE] = self._free[1:, CLOCK] = True
        self._free[:, BIAS] = True

    def _moved(self, x: F64) -> tuple[F64, F64, F64]:
        """Return positions and rays (GxCx3) in the frame of the reference, and sigmas (2xGxC).

        The sigmas are those across the ray and along it.
        """
        g = self.groups
        turns = Rotation.from_rotvec(x[:, :3]).as_matrix()
        late_s = x[:, 6] + x[:, 7] * g.times_s[:, None] - g.offsets_s
        points = (g.points_m + g.velocities_mps * late_s[..., None]) * (1 + x[:, [9, 9, 10]])
        distance = np.linalg.norm(points, axis=-1)
        rays = np.einsum("cij,gcj->gci", turns, points / distance[..., None])
        # Errors across the ray grow with the corrected distance. Without that, all cameras would
        # be drawn to the people: the smaller the distances, the smaller the errors.
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
        """Return whitened differences, and what was known before."""
        up = np.array([_turn(x[k]) @ self._up[k] for k in range(self._count)])
        known = [
            ((up[1:] - up[0]) / (np.sqrt(2) * UP_SIGMA_RAD)).ravel(),
            x[:, 7] / DRIFT_SIGMA,
            (x[:, 8] - x[:, 8].mean()) / BIAS_SIGMA_M,
            x[:, 8].mean(keepdims=True) / COMMON_BIAS_SIGMA_M,
            (x[:, SCALE] / SCALE_SIGMA).ravel(),
            # A scale common to all cameras does not show: all differences shrink with it.
            x[:, SCALE].mean(axis=0, keepdims=True).ravel() / COMMON_SCALE_SIGMA,
        ]
        observed = self.differences(x)[self.groups.has].ravel()
        return np.concatenate([observed, *(np.sqrt(CORRELATED) * k for k in known)])

    def solve(self, start: F64) -> F64:
        """Return the parameters of least residuals."""
        x = start.copy()
        free = self._free

        def of(values: F64) -> F64:
            x[free] = values
            return self.residuals(x)

        found = least_squares(of, start[free], loss="soft_l1", f_scale=2.0, x_scale="jac")
        x[free] = found.x
        return x

    def covariance(self, x: F64) -> F64:
        """Return covariances (Cx8x8) of pose and clock of each camera."""
        full, index = self._covariance(x), np.cumsum(self._free.ravel()).reshape(-1, PARAMETERS) - 1
        result = np.zeros((self._count, 8, 8))
        for k in range(1, self._count):
            rows = index[k, :8]
            result[k] = full[np.ix_(rows, rows)]
        return result

    def scales(self, x: F64) -> tuple[F64, F64]:
        """Return changes of scale (Cx2) that fit best, and their standard deviations."""
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
        """Return the squared distances of positions of each pair that has some."""
        points, _, _ = self._moved(x)
        pairs = combinations(range(self._count), 2)
        return {
            (a, b): ((points[both, a] - points[both, b]) ** 2).sum(axis=-1)
            for a, b in pairs
            if (both := self.groups.pair(a, b)).any()
        }

    def _covariance(self, x: F64) -> F64:
        free, at = self._free, x.copy()
        values = x[free]
        base = self.residuals(x)
        jacobian = np.empty((len(base), len(values)))
        for k in range(len(values)):
            at[free] = values + STEP * (np.arange(len(values)) == k)
            jacobian[:, k] = (self.residuals(at) - base) / STEP
        # The variance of residuals as it is; consecutive ones are alike.
        torsos = self.groups.torsos
        count = int(self.groups.has[:torsos].sum())
        variance = max(float(np.median(np.abs(base[: 3 * count])) / 0.6745) ** 2, 0.04)
        variance *= count / (count - torsos)  # the means fit as well
        size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
        inverse = np.linalg.pinv((jacobian / size).T @ (jacobian / size), hermitian=True)
        return np.asarray(inverse / np.outer(size, size) * variance * CORRELATED)


def _level_pose(x: F64, reference_level: F64, level: F64) -> LevelPose:
    rotation = reference_level @ _turn(x) @ level.T
    yaw = float(np.arctan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1]))
    return LevelPose(yaw, reference_level @ x[3:6], float(x[6]), tilted=rotation)


def _turn(x: F64) -> F64:
    return np.asarray(Rotation.from_rotvec(x[:3]).as_matrix())


def _matrix(x: F64) -> F64:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = _turn(x), x[3:6]
    return matrix
