"""Alignment of truth to the clock and frame of the tracks.

A known calibration is applied with `transform_truth`. An unknown one can be estimated from the
tracks (`estimate_clock`, `estimate_motion`) to find faults of the set-up. It is reported with the
errors, since a fitted alignment also removes errors of the tracks.
"""

import math
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from common.geometry.transforms import apply, rotation_from_rpy, transform_from, wrap
from common.metrics.alignment.trajectories import Trajectories, TrajectoryPairs, cost, pair_up
from people4d.messages import F64, Truth, TruthPerson

COARSE_S = 0.1  # [s] step of the first search for the clock offset
MIN_SAMPLES = 20
MIN_SPREAD_MPS = 0.15  # [m/s] minimum rms spread of velocities that separates time from position
MIN_SPREAD_M = 0.1  # [m] minimum rms spread of people that separates rotation from shift
ROUNDS = 20
SETTLED = 1e-12
OUTLIER = 3.0  # minimum residual of an outlier [medians]


@dataclass(frozen=True)
class ClockOffset:
    """Offset to be added to stamps of the truth."""

    offset_s: float  # [s]
    sigma_s: float  # [s] standard deviation for independent errors
    samples: int  # number of track positions


@dataclass(frozen=True)
class SpaceAlignment:
    """Motion of the truth to the frame of the tracks."""

    matrix: F64  # [m] 4x4, tracks' frame from truth's frame
    rmse_before_m: float  # [m] horizontal error before the motion
    rmse_after_m: float  # [m] horizontal error after the motion
    samples: int


def transform_truth(truth: Truth, matrix: F64, frame_id: str) -> Truth:
    """Transform truth to another frame by a 4x4 transform."""
    people = tuple(_moved_person(person, matrix) for person in truth.people)
    return msgspec.structs.replace(truth, frame_id=frame_id, people=people)


def fit_2d(source_m: F64, target_m: F64) -> F64:
    """Return the least-squares rotation about z and shift (4x4) from source to target points.

    At least one pair of points (Nx3 each) is required.

    Source: docs/method.md section 24 [Umeyama 1991], in the plane and without scale.
    """
    centre_a, centre_b = source_m.mean(axis=0), target_m.mean(axis=0)
    a, b = source_m - centre_a, target_m - centre_b
    crossed = np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    turn = math.atan2(float(crossed), float(np.sum(a[:, :2] * b[:, :2])))
    rotation = rotation_from_rpy(0.0, 0.0, turn)
    return transform_from(centre_b - rotation @ centre_a, rotation)


def fit_3d(source_m: F64, target_m: F64) -> F64:
    """Return the least-squares rotation and shift (4x4) from source to target points.

    At least three pairs of points (Nx3 each), not on one line, are required.

    Source: docs/method.md section 24 [Umeyama 1991], without scale.
    """
    centre_a, centre_b = source_m.mean(axis=0), target_m.mean(axis=0)
    U, _, Vt = np.linalg.svd((target_m - centre_b).T @ (source_m - centre_a))
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    rotation = U @ mirror @ Vt
    return transform_from(centre_b - rotation @ centre_a, rotation)


def estimate_clock(
    truth: Trajectories, tracked: Trajectories, widest_s: float = 0.5
) -> ClockOffset | None:
    """Estimate the constant offset of both clocks, together with a constant error of positions.

    A track is at the delayed position of its person plus a shift: p(t) = q(t - d) + b. After a
    search in steps of 0.1 s, d and b follow from least squares (Gauss-Newton).

    None if the offset exceeds `widest_s`, there are too few samples, or all velocities are similar,
    which makes shift and offset indistinguishable.
    """
    steps = round(widest_s / COARSE_S)
    coarse = COARSE_S * np.arange(-steps, steps + 1)
    offset_s = float(coarse[np.argmin([cost(truth, tracked, float(d)) for d in coarse])])
    solution = None
    for _ in range(ROUNDS):
        solution = _clock_step(pair_up(truth, tracked, offset_s))
        if solution is None:
            return None
        offset_s += solution.offset_s
        if abs(solution.offset_s) < SETTLED:
            break
    if solution is None or abs(offset_s) > widest_s + COARSE_S:
        return None
    return ClockOffset(offset_s, solution.sigma_s, solution.samples)


def estimate_motion(
    truth: Trajectories, tracked: Trajectories, offset_s: float = 0.0, dimensions: Literal[2, 3] = 2
) -> SpaceAlignment | None:
    """Estimate the rigid motion of the truth to the frame of the tracks, of less than a metre.

    Pairs and motion are found alternately, as in iterative closest points. None if there are too
    few samples, or they do not determine the rotation: people hardly move, or (in 3D) only along
    one line.

    Args:
        truth: Trajectories of people.
        tracked: Trajectories of tracks.
        offset_s: Added to stamps of the truth.
        dimensions: 2 for a turn about z and a shift, 3 for any rotation.
    """
    matrix = np.eye(4)
    pairs = pair_up(truth, tracked, offset_s)
    before_m = pairs.rmse_m(matrix)
    for _ in range(ROUNDS):
        if not _determines_rotation(pairs.true_m, dimensions):
            return None
        fit = fit_2d if dimensions == 2 else fit_3d
        last, matrix = matrix, fit(pairs.true_m, pairs.tracked_m)
        pairs = pair_up(truth, tracked, offset_s, matrix)
        if np.abs(matrix - last).max() < SETTLED:
            break
    return SpaceAlignment(matrix, before_m, pairs.rmse_m(matrix), len(pairs.true_m))


def _determines_rotation(points_m: F64, dimensions: Literal[2, 3]) -> bool:
    """Check that points lie far enough apart: in one direction, or for 3D in two."""
    if len(points_m) < MIN_SAMPLES:
        return False
    centred = (points_m - points_m.mean(axis=0))[:, :dimensions]
    spread_m = np.linalg.svd(centred, compute_uv=False) / math.sqrt(len(points_m))
    return bool(spread_m[dimensions - 2] >= MIN_SPREAD_M)


def _clock_step(pairs: TrajectoryPairs) -> ClockOffset | None:
    """Return the change of the offset that explains the residuals best, with a constant shift."""
    residual, velocity = (pairs.tracked_m - pairs.true_m)[:, :2], pairs.velocity_mps[:, :2]
    if len(residual) < MIN_SAMPLES:
        return None
    distance = np.linalg.norm(residual - np.median(residual, axis=0), axis=1)
    inliers = distance <= OUTLIER * np.median(distance) + 1e-9
    residual, velocity = residual[inliers], velocity[inliers]
    # r = b - v d; subtracting the means eliminates b.
    residual, velocity = residual - residual.mean(axis=0), velocity - velocity.mean(axis=0)
    information = float(np.sum(velocity**2))
    if math.sqrt(information / len(velocity)) < MIN_SPREAD_MPS:
        return None
    change_s = -float(np.sum(velocity * residual)) / information
    left = residual + change_s * velocity
    sigma_s = math.sqrt(float(np.sum(left**2)) / (2 * len(left) - 3) / information)
    return ClockOffset(change_s, sigma_s, len(left))


def _moved_person(person: TruthPerson, matrix: F64) -> TruthPerson:
    velocity = person.velocity_mps
    return TruthPerson(
        id=person.id,
        position_m=apply(matrix, person.position_m),
        velocity_mps=None if velocity is None else matrix[:3, :3] @ velocity,
        yaw_rad=_turned(person.yaw_rad, matrix),
        path_yaw_rad=_turned(person.path_yaw_rad, matrix),
    )


def _turned(yaw_rad: float | None, matrix: F64) -> float | None:
    """Return a yaw after a rotation (4x4), projected on the ground."""
    if yaw_rad is None:
        return None
    x, y = matrix[:2, :2] @ (math.cos(yaw_rad), math.sin(yaw_rad))
    return wrap(math.atan2(y, x))
