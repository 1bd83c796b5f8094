"""Joint least squares over the poses and clocks of all cameras, with covariance.

Parameters of each camera except the reference: rotation and translation, offset and drift of its
clock. Parameter of each camera: bias of positions along the ray. Residuals of people and of the
floor are defined in `residuals.Residuals`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from common.calibration.floor import MeasuredFloor
from common.calibration.graph import Pair
from common.calibration.groups import find_groups
from common.calibration.level_paths import LevelPaths
from common.calibration.pairs import LevelPose
from common.calibration.residuals import PARAMETERS, Residuals, turn_of
from common.geometry.transforms import transform_from
from people4d.errors import CalibrationError
from people4d.messages import F64

GATES_M = (0.45, 0.4, 0.35)  # maximum distance of two positions of one person, by round
# Maximum difference of a camera's floor from the common one [m, rad]: at first poses, at final ones
FLOOR_FIRST, FLOOR_LAST = (0.2, np.radians(3)), (0.04, np.radians(0.7))


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Pose of a camera's optical frame in the reference frame, and its clock offset."""

    matrix: F64  # 4x4, reference_from_camera
    offset_s: float  # [s] camera clock minus reference clock, in the middle of the observed time
    drift: float  # growth of the offset per second
    bias_m: float  # [m] added to the distance of every position
    covariance: F64  # 8x8: rotation [rad], translation [m], offset [s], drift
    # best-fitting scales across and along the axis; 1 for correct intrinsics
    scales: tuple[float, float]
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
    """Poses of all cameras, and the remaining differences."""

    poses: Mapping[str, CameraPose]
    pair_rms_m: Mapping[Pair, float]
    pair_seconds: Mapping[Pair, float]  # [s] time with a person in view of both cameras
    rms_m: float
    floor: MeasuredFloor | None  # floor from depth, in the frame of the reference
    floor_cameras: Sequence[str]  # cameras with the floor in view
    odd_floors: Sequence[str]  # cameras whose floor is higher, lower or tilted


def adjust(
    cameras: Mapping[str, LevelPaths],
    first: Mapping[str, LevelPose],
    reference: str,
    floors: Mapping[str, MeasuredFloor],
) -> AdjustmentResult:
    """Return the poses at which the people of all cameras coincide.

    CalibrationError if no two cameras have positions of one person.

    Args:
        cameras: Paths by name, of all cameras in `first`.
        first: Poses to begin with, in the level frame of the reference.
        reference: Camera that is the origin of poses and clocks.
        floors: Floor in view of each camera, optical frame; may lack cameras.
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
    problem = Residuals(np.array([level[name][2] for name in names]))
    used = {k: floors[name] for k, name in enumerate(names) if name in floors}
    poses = dict(first)
    for gate_m in GATES_M:
        problem.groups = find_groups([cameras[name] for name in names], poses, gate_m, middle)
        absent = [name for k, name in enumerate(names) if not problem.groups.has[:, k].any()]
        if absent:
            apart = ", ".join(absent)
            raise CalibrationError(
                f"positions of people in {apart} disagree with the other cameras",
                "Depth or intrinsics of a camera are wrong, or it moved.",
            )
        start = problem.solve(start)
        if gate_m == GATES_M[0]:
            problem.set_floors(used)
            _leave_odd_floors(problem, used, start, FLOOR_FIRST)
        poses = {
            name: _level_pose(start[k], level[reference], level[name])
            for k, name in enumerate(names)
        }
    while _leave_odd_floors(problem, used, start, FLOOR_LAST):
        start = problem.solve(start)
    scaled, scale_sigmas = problem.scales(start)
    covariance = problem.covariances(start)
    squares = problem.squares_m2(start)
    total = sum(len(s) for s in squares.values())
    steps_s = problem.groups.times_s
    return AdjustmentResult(
        poses={
            name: CameraPose(
                matrix=transform_from(start[k, 3:6], turn_of(start[k])),
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
        floor=problem.floor(start),
        floor_cameras=[names[k] for k in used],
        odd_floors=[name for k, name in enumerate(names) if name in floors and k not in used],
    )


def _leave_odd_floors(
    problem: Residuals, used: dict[int, MeasuredFloor], x: F64, limits: tuple[float, float]
) -> bool:
    """Remove the most different floors until all agree; return True if one was removed."""
    before = len(used)
    while True:
        odd = {
            k: max(apart_m / limits[0], apart_rad / limits[1])
            for k, (apart_m, apart_rad) in problem.floor_differences(x).items()
        }
        worst = max(odd.values(), default=0.0)
        if worst <= 1:
            return len(used) < before
        for k in [k for k, share in odd.items() if share == worst or len(odd) == 2]:
            del used[k]  # either of two may be wrong
        problem.set_floors(used)


def _level_pose(x: F64, reference_level: F64, level: F64) -> LevelPose:
    rotation = reference_level @ turn_of(x) @ level.T
    yaw = float(np.arctan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1]))
    return LevelPose(yaw, reference_level @ x[3:6], float(x[6]), tilted=rotation)
