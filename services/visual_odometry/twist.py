"""Twists and rigid motions; a twist is (6) vx, vy, vz, wx, wy, wz."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from common.geometry.transforms import transform_from
from people4d.messages import F64


def arc_motion(twist: F64) -> F64:
    """Return the motion (4x4) along an arc, of a constant twist during 1 s."""
    turn = twist[3:]
    angle = float(np.linalg.norm(turn))
    rotation = Rotation.from_rotvec(turn).as_matrix()
    # At half the turn the direction of the chord is exact.
    half = Rotation.from_rotvec(turn / 2).as_matrix()
    chord = math.sin(angle / 2) / (angle / 2) if angle > 1e-9 else 1.0
    return transform_from(chord * (half @ twist[:3]), rotation)


def twist_of(matrix: F64) -> F64:
    """Return the small twist (6) of a 4x4 motion."""
    return np.concatenate([matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]).as_rotvec()])


def adjoint(target_from_source: F64) -> F64:
    """Return the 6x6 that transforms a twist between two rigidly connected frames."""
    turn, (x, y, z) = target_from_source[:3, :3], target_from_source[:3, 3]
    moved = np.zeros((6, 6))
    moved[:3, :3] = moved[3:, 3:] = turn
    moved[:3, 3:] = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ turn
    return moved


def small_motions(twists: F64) -> F64:
    """Return the motions (Hx4x4) of small twists (Hx6) by Rodrigues' formula."""
    angles = np.linalg.norm(twists[:, 3:], axis=1)[:, None, None]
    cross = cross_matrices(twists[:, 3:])
    motions = np.repeat(np.eye(4)[None], len(twists), axis=0)
    motions[:, :3, :3] += np.sinc(angles / np.pi) * cross
    motions[:, :3, :3] += np.sinc(angles / 2 / np.pi) ** 2 / 2 * (cross @ cross)
    motions[:, :3, 3] = twists[:, :3]
    return motions


def rotation_vectors(rotations: F64) -> F64:
    """Return the rotation vectors (Hx3) of rotations (Hx3x3) below a quarter turn."""
    r = rotations
    sines = (
        np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], 1) / 2
    )
    length = np.linalg.norm(sines, axis=1, keepdims=True).clip(1e-12, 1.0)
    return np.asarray(sines * np.arcsin(length) / length)


def cross_matrices(points: F64) -> F64:
    """Return ...x3x3 matrices [p]x, so that p x w = [p]x w."""
    x, y, z = np.moveaxis(points, -1, 0)
    crossed = np.zeros((*x.shape, 3, 3))
    crossed[..., 0, 1], crossed[..., 0, 2], crossed[..., 1, 2] = -z, y, -x
    crossed[..., 1, 0], crossed[..., 2, 0], crossed[..., 2, 1] = z, -y, x
    return crossed
