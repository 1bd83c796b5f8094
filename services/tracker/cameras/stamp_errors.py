"""Errors of the stamps of cameras, from walking people in view of two cameras.

A message arrives late if the clock of its camera is behind or the transport is slow. With wrong
stamps the positions of a person by two cameras differ along the direction of walking, and the
difference changes sign when the person returns. If only messages are late, the positions agree.
Source: docs/method.md, section 24.
"""

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np

from people4d.messages import F64

SAMPLES_MIN = 20  # minimum samples of a pair of cameras
SPEED_MIN_MPS = 0.3  # minimum speed of a person in a sample [m/s]
ROBUST_M = 0.2  # scale of differences in the robust cost [m]
ITERATIONS = 4  # iterations of the reweighted fit
POSE_SIGMA_M = 0.1  # prior standard deviation of a shift between two cameras [m]
TURN_SIGMA_RAD = 0.1  # prior standard deviation of a rotation about the vertical [rad]
STAMP_SIGMA_S = 10.0  # prior standard deviation of an error of stamps [s]
ALIKE = 3.0  # assumed number of consecutive samples with the same error
Pair: TypeAlias = tuple[str, str]


class Walked(NamedTuple):
    """N samples of people in view of two cameras."""

    apart_m: F64  # Nx3, position by the first camera minus position by the second
    ray_m: F64  # Nx3, from the first camera to the person
    velocity_mps: F64  # Nx3, NaN where unknown
    between_s: F64  # [s] N, stamp of the first frame minus the second stamp


class StampError(NamedTuple):
    """Error of the stamps of a camera against the reference."""

    ahead_s: float
    sigma_s: float


def stamp_errors(walked: Mapping[Pair, Walked], reference: str) -> dict[str, StampError]:
    """Return the errors of all cameras with enough samples.

    Args:
        walked: Samples by pair of cameras.
        reference: Camera whose stamps are correct.
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
    """Return the error of the first camera's stamps against the second's [s], and its variance.

    With stamps ahead by e, the positions of a person at velocity v and ray r differ by
    b + w x r + v (dt - e), where shift b and rotation w are errors of the poses.
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
