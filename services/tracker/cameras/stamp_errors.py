"""Errors of the stamps of cameras, by people who walk before two of them at once.

A message may come late because its camera's clock is behind or because it was long on its path.
Where stamps are wrong, two cameras have a person apart along the direction of walking, and the
other way round when the person returns; where messages are late alone they agree. Section 24 of
docs/method.md.
"""

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np

from people4d.messages import F64

SAMPLES_MIN = 20  # of a pair of cameras
SPEED_MIN_MPS = 0.3  # slower people say nothing
ROBUST_M = 0.2  # of differences in the cost, which has a limit for two people taken for one
ITERATIONS = 4  # of the reweighted fit
POSE_SIGMA_M = 0.1  # standard deviation of a constant difference of two cameras' positions before
TURN_SIGMA_RAD = 0.1  # and of a rotation about the vertical
STAMP_SIGMA_S = 10.0  # and of errors of stamps
ALIKE = 3.0  # samples in a row with one error
Pair: TypeAlias = tuple[str, str]


class Walked(NamedTuple):
    """People before two cameras at once, N samples."""

    apart_m: F64  # Nx3, position by the first camera minus that by the second
    ray_m: F64  # Nx3, from the first camera
    velocity_mps: F64  # Nx3, NaN where unknown
    between_s: F64  # [s] N, stamp of the first frame minus the second stamp


class StampError(NamedTuple):
    """Error of the stamps of a camera against the reference."""

    ahead_s: float
    sigma_s: float


def stamp_errors(walked: Mapping[Pair, Walked], reference: str) -> dict[str, StampError]:
    """Return the errors of cameras against the reference; without those that nothing is known of.

    Args:
        walked: People before pairs of cameras.
        reference: Camera whose stamps are right.
    """
    pairs = {pair: found for pair, w in walked.items() if (found := _of_pair(w)) is not None}
    others = sorted({camera for pair in pairs for camera in pair} - {reference})
    if not others:
        return {}
    information = np.eye(len(others)) / STAMP_SIGMA_S**2
    right = np.zeros(len(others))
    for pair, (ahead_s, variance_s2) in pairs.items():
        row = np.zeros(len(others))
        for camera, sign in zip(pair, (1.0, -1.0), strict=True):
            if camera != reference:
                row[others.index(camera)] = sign
        information += np.outer(row, row) / variance_s2
        right += row * ahead_s / variance_s2
    covariance = np.linalg.inv(information)
    ahead = covariance @ right
    return {
        camera: StampError(float(ahead[k]), float(np.sqrt(covariance[k, k])))
        for k, camera in enumerate(others)
    }


def _of_pair(walked: Walked) -> tuple[float, float] | None:
    """Return by how much the first camera's stamps are ahead of the second's, and the variance.

    With stamps ahead by e, a person at velocity v and ray r is apart by b + w x r + v (dt - e), b
    and w of the poses.
    """
    speed = np.linalg.norm(walked.velocity_mps[:, :2], axis=1)
    moves = speed > SPEED_MIN_MPS  # not NaN
    if moves.sum() < SAMPLES_MIN:
        return None
    velocity = walked.velocity_mps[moves, :2]
    apart = walked.apart_m[moves, :2] - velocity * walked.between_s[moves, None]
    jacobian = np.zeros((len(apart), 2, 4))  # shift, rotation, stamp
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1.0
    jacobian[:, 0, 2], jacobian[:, 1, 2] = -walked.ray_m[moves, 1], walked.ray_m[moves, 0]
    jacobian[:, :, 3] = -velocity
    prior = np.diag(np.array([POSE_SIGMA_M, POSE_SIGMA_M, TURN_SIGMA_RAD, STAMP_SIGMA_S]) ** -2.0)
    weights = np.ones(len(apart))
    for _ in range(ITERATIONS):
        normal = np.einsum("n,nij,nik->jk", weights, jacobian, jacobian)
        solution = np.linalg.solve(
            normal + 1e-6 * prior, np.einsum("n,nij,ni->j", weights, jacobian, apart)
        )
        remaining = apart - jacobian @ solution
        squares = (remaining**2).sum(axis=1)
        weights = 1 / (1 + squares / ROBUST_M**2) ** 2
    variance_m2 = max(float((weights * squares).sum() / (2 * weights.sum())), 1e-4)
    covariance = np.linalg.inv(normal / (variance_m2 * ALIKE) + prior)
    estimate = covariance @ (
        np.einsum("n,nij,ni->j", weights, jacobian, apart) / (variance_m2 * ALIKE)
    )
    return float(estimate[3]), float(covariance[3, 3])
