"""Stacks of rotation matrices, for whole time series."""

import numpy as np
import numpy.typing as npt

from people4d.messages import F64


def about_x(angle_rad: npt.ArrayLike) -> F64:
    """Return the rotations about x, shape of the angles plus 3x3."""
    return _about(np.asarray(angle_rad, np.float64), 1, 2)


def about_y(angle_rad: npt.ArrayLike) -> F64:
    """Return the rotations about y, shape of the angles plus 3x3."""
    return _about(np.asarray(angle_rad, np.float64), 2, 0)


def about_z(angle_rad: npt.ArrayLike) -> F64:
    """Return the rotations about z, shape of the angles plus 3x3."""
    return _about(np.asarray(angle_rad, np.float64), 0, 1)


def _about(angle: F64, i: int, j: int) -> F64:
    rotation = np.zeros((*angle.shape, 3, 3))
    rotation[..., [0, 1, 2], [0, 1, 2]] = 1.0
    rotation[..., i, i] = rotation[..., j, j] = np.cos(angle)
    rotation[..., j, i] = np.sin(angle)
    rotation[..., i, j] = -rotation[..., j, i]
    return rotation


def turn(rotation: F64, vector: F64) -> F64:
    """Rotate vectors: ...x3x3 times ...x3."""
    return np.asarray(np.einsum("...ij,...j->...i", rotation, vector))


def along(direction: F64, lateral: F64) -> F64:
    """Return frames ...x3x3 with a direction as -z axis and the y axis nearest to `lateral`."""
    up = -direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    left = lateral - up * np.sum(lateral * up, axis=-1, keepdims=True)
    left = left / np.linalg.norm(left, axis=-1, keepdims=True)
    return np.stack([np.cross(left, up), left, up], axis=-1)
