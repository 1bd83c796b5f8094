"""Joint least squares over the poses and clocks of all cameras, with covariance.

Unknown of each camera but the reference: rotation and translation, offset and drift of its clock.
Unknown of each camera: by how much positions lie before or behind the person (bias along the ray).
A residual is the difference of one person's positions by two cameras at one time, or that of the
directions up that two cameras see.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from common.calibration.graph import Pair
from common.calibration.pairs import LevelPaths, LevelPose, correspond
from common.calibration.tracklets import STEP_S
from people4d.errors import CalibrationError
from people4d.messages import F64

GATES_M = (0.45, 0.4, 0.35)  # of two positions of one person, by round
ACROSS_SIGMA_M, DEPTH_SIGMA_M, DEPTH_SIGMA_PER_M = 0.02, 0.02, 0.004  # at depth z: s + k z^2
BIAS_SIGMA_M = 0.03  # of what is known before
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


@dataclass(slots=True)
class _Samples:
    """Positions of the same people in a pair of cameras, optical frames."""

    a: int
    b: int
    times_s: F64  # N, on the clock of a, from the middle of the time
    late_s: float  # step of b minus that of a, in time
    a_m: F64
    b_m: F64
    b_mps: F64


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
    steps = np.concatenate([[p.first, p.last] for n in names for p in cameras[n].paths])
    middle = int((steps.min() + steps.max()) / 2)
    problem = _Problem(len(names), np.array([level[name][2] for name in names]))
    poses = dict(first)
    for gate_m in GATES_M:
        problem.samples = [
            sample
            for i, a in enumerate(names)
            for j, b in enumerate(names[i + 1 :], i + 1)
            if (sample := _samples(cameras[a], cameras[b], poses, gate_m, (i, j), middle))
        ]
        linked = {k for s in problem.samples for k in (s.a, s.b)}
        if len(linked) < len(names):
            apart = ", ".join(name for k, name in enumerate(names) if k not in linked)
            raise CalibrationError(
                f"people before {apart} are not where the other cameras have them",
                "Depth or intrinsics of a camera are wrong, or it moved.",
            )
        problem.weigh(start)
        start = problem.solve(start)
        poses = {
            name: _level_pose(start[k], level[reference], level[name])
            for k, name in enumerate(names)
        }
    covariance = problem.covariance(start)
    scaled, scale_sigmas = problem.scales(start)
    rms = problem.rms_m(start)
    total = np.concatenate([s.times_s for s in problem.samples])
    squares = sum(rms[s.a, s.b] ** 2 * len(s.times_s) for s in problem.samples)
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
        pair_rms_m={(names[i], names[j]): value for (i, j), value in rms.items()},
        pair_seconds={
            (names[s.a], names[s.b]): len(np.unique(s.times_s)) * STEP_S for s in problem.samples
        },
        rms_m=float(np.sqrt(squares / max(len(total), 1))),
    )


class _Problem:
    """Residuals of samples as a function of the parameters of all cameras."""

    def __init__(self, count: int, up: F64) -> None:
        self._count, self._up = count, up
        self.samples: Sequence[_Samples] = []
        self._whiteners: list[F64] = []
        self._free = np.zeros((count, PARAMETERS), np.bool_)
        self._free[1:, POSE] = self._free[1:, CLOCK] = True
        self._free[:, BIAS] = True

    def weigh(self, x: F64) -> None:
        """Fix the weights of residuals by the present poses."""
        self._whiteners = []
        for s in self.samples:
            total = _covariances(s.a_m, _turn(x[s.a])) + _covariances(s.b_m, _turn(x[s.b]))
            self._whiteners.append(np.linalg.inv(np.linalg.cholesky(total)))

    def differences(self, x: F64) -> list[F64]:
        """Return differences of positions [m] of each pair, Nx3."""
        found = []
        for s in self.samples:
            # Time on the clock of b at each sample, less that of the step it was taken from.
            offset_s = x[s.b, 6] - x[s.a, 6] + (x[s.b, 7] - x[s.a, 7]) * s.times_s - s.late_s
            b_m = s.b_m + s.b_mps * offset_s[:, None]
            found.append(_moved(x[s.a], s.a_m) - _moved(x[s.b], b_m))
        return found

    def residuals(self, x: F64) -> F64:
        """Return whitened differences, and what was known before."""
        parts = [
            np.einsum("nij,nj->ni", w, d).ravel()
            for w, d in zip(self._whiteners, self.differences(x), strict=True)
        ]
        up = np.array([_turn(x[k]) @ self._up[k] for k in range(self._count)])
        known = [
            ((up[1:] - up[0]) / (np.sqrt(2) * UP_SIGMA_RAD)).ravel(),
            x[:, 7] / DRIFT_SIGMA,
            x[:, 8] / BIAS_SIGMA_M,
            (x[:, SCALE] / SCALE_SIGMA).ravel(),
            # A scale common to all cameras does not show: all differences shrink with it.
            x[:, SCALE].mean(axis=0, keepdims=True).ravel() / COMMON_SCALE_SIGMA,
        ]
        return np.concatenate([*parts, *(np.sqrt(CORRELATED) * k for k in known)])

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

    def rms_m(self, x: F64) -> dict[tuple[int, int], float]:
        """Return the RMS difference of positions of each pair."""
        return {
            (s.a, s.b): float(np.sqrt((d**2).sum(axis=1).mean()))
            for s, d in zip(self.samples, self.differences(x), strict=True)
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
        data = base[: sum(3 * len(s.times_s) for s in self.samples)]
        variance = max(float(np.median(np.abs(data)) / 0.6745) ** 2, 0.25) if len(data) else 1.0
        size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
        inverse = np.linalg.pinv((jacobian / size).T @ (jacobian / size), hermitian=True)
        return np.asarray(inverse / np.outer(size, size) * variance * CORRELATED)


def _samples(
    a: LevelPaths,
    b: LevelPaths,
    poses: Mapping[str, LevelPose],
    gate_m: float,
    numbers: tuple[int, int],
    middle: int,
) -> _Samples | None:
    one, other = poses[a.camera], poses[b.camera]
    back = one.rotation.T
    pose = LevelPose(
        other.yaw_rad - one.yaw_rad,
        back @ (other.translation_m - one.translation_m),
        other.offset_s - one.offset_s,
        tilted=back @ other.rotation,
    )
    found = correspond(a, b, pose, gate_m)
    if len(found.steps) < 3:
        return None
    return _Samples(
        *numbers,
        times_s=np.asarray((found.steps - middle) * STEP_S, np.float64),
        late_s=found.shift * STEP_S,
        a_m=found.a_m @ a.level_from_optical,
        b_m=found.b_m @ b.level_from_optical,
        b_mps=found.b_mps @ b.level_from_optical,
    )


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


def _moved(x: F64, points_m: F64) -> F64:
    """Return points (Nx3) of a camera in the frame of the reference, corrected."""
    scaled = points_m * (1 + x[[9, 9, 10]])
    distance = np.linalg.norm(scaled, axis=1, keepdims=True)
    return np.asarray((scaled * (1 + x[8] / distance)) @ _turn(x).T + x[3:6])


def _covariances(points_m: F64, rotation: F64) -> F64:
    """Return the expected covariances (Nx3x3) of positions, turned."""
    distance = np.linalg.norm(points_m, axis=1)
    ray = (points_m / distance[:, None]) @ rotation.T
    along = (DEPTH_SIGMA_M + DEPTH_SIGMA_PER_M * distance**2) ** 2 - ACROSS_SIGMA_M**2
    outer = ray[:, :, None] * ray[:, None, :]
    return np.asarray(ACROSS_SIGMA_M**2 * np.eye(3) + along.clip(0)[:, None, None] * outer)
