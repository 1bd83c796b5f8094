"""Poses by tags, joined with the poses by walking if two cameras or more see tags."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import approx_fprime
from scipy.spatial.transform import Rotation

from common.geometry.transforms import apply, invert, project, transform_from
from people4d.messages import F64, CameraInfo

CORNER_SIGMA_PX = 0.5  # error of each corner
MEASURED_SIGMAS = np.array(
    [0.005, 0.005, 0.005, 0.01, 0.01, 0.01]
)  # [rad, m] errors of tags in the map
CONTRADICTION = 3.0  # minimum RMS of normalised differences at which tags are ignored
STEP = 1e-6  # step of numeric derivatives


@dataclass(frozen=True, slots=True)
class TagPose:
    """Pose of a camera by tags."""

    map_from_camera: F64  # 4x4
    covariance: F64  # 6x6: rotation [rad], translation [m], in the frame of the camera

    @classmethod
    def of(cls, map_from_camera: F64, corners_m: F64, info: CameraInfo) -> "TagPose":
        """Return a pose with its covariance due to errors of the corners (Nx3, map)."""

        def pixels(motion: F64) -> F64:
            return project(
                apply(invert(map_from_camera @ _motion(motion)), corners_m), info
            ).ravel()

        jacobian = approx_fprime(np.zeros(6), pixels, STEP)
        covariance = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True) * CORNER_SIGMA_PX**2
        return cls(map_from_camera, np.asarray(covariance + np.diag(MEASURED_SIGMAS**2)))


def fuse(
    values: F64, covariance: F64, matrices: Callable[[F64], Sequence[F64]], tags: Sequence[TagPose]
) -> tuple[F64, F64]:
    """Return parameters and their covariance, updated by the poses of tags.

    They are unchanged if tags contradict them.

    Args:
        values: Parameters of all cameras by walking.
        covariance: Covariance of the parameters.
        matrices: Returns the poses (4x4) of the cameras that see tags, by the parameters.
        tags: Poses of these cameras by tags.
    """
    base, *others = tags
    expected = [invert(base.map_from_camera) @ tag.map_from_camera for tag in others]

    def differences(x: F64) -> F64:
        first, *rest = matrices(x)
        pairs = zip(expected, rest, strict=True)
        return np.concatenate([_vector(invert(e) @ invert(first) @ m) for e, m in pairs])

    moved = np.concatenate([_adjoint(invert(e)) for e in expected])
    noise = moved @ base.covariance @ moved.T
    for k, tag in enumerate(others):
        rows = slice(6 * k, 6 * k + 6)
        noise[rows, rows] += tag.covariance
    error, jacobian = differences(values), approx_fprime(values, differences, STEP)
    total = jacobian @ covariance @ jacobian.T + noise
    if np.sqrt(error @ np.linalg.solve(total, error) / len(error)) > CONTRADICTION:
        return values, covariance
    gain = np.linalg.solve(total, jacobian @ covariance).T
    joined = covariance - gain @ jacobian @ covariance
    return values - gain @ error, np.asarray((joined + joined.T) / 2)


def tag_poses(
    poses: Mapping[str, F64], corners_m: Mapping[str, F64], infos: Mapping[str, CameraInfo]
) -> dict[str, TagPose]:
    """Return poses by tags (4x4, by camera) with their covariances."""
    return {name: TagPose.of(pose, corners_m[name], infos[name]) for name, pose in poses.items()}


def _motion(vector: F64) -> F64:
    return transform_from(vector[3:], Rotation.from_rotvec(vector[:3]).as_matrix())


def _vector(motion: F64) -> F64:
    return np.append(Rotation.from_matrix(motion[:3, :3]).as_rotvec(), motion[:3, 3])


def _adjoint(motion: F64) -> F64:
    """Return the matrix (6x6) that brings small motions from the source frame to the target."""
    x, y, z = motion[:3, 3]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = motion[:3, :3]
    return np.block([[turn, np.zeros((3, 3))], [cross @ turn, turn]])
