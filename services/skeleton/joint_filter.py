"""Kalman filters of the joints of all people: position and velocity of each joint.

Joints are filtered independently; a bone is a measurement of the distance of two joints.
"""

from dataclasses import dataclass

import numpy as np

from common.kalman import predict, update
from people4d.messages import F64
from services.skeleton.body import AGILITY_MPS2, Bones

UNKNOWN_M2 = 1e4  # variance of a missing measurement [m^2]
LASTS_S = 0.3  # time constant of the motion of a joint relative to the body [s]


@dataclass
class JointStates:
    """States of the joints of N people in a fixed frame."""

    mean: F64  # Nx17x6: position in metres, velocity in m/s
    covariance: F64  # Nx17x6x6

    @property
    def position_m(self) -> F64:
        """Positions, Nx17x3."""
        return self.mean[..., :3]

    @property
    def position_m2(self) -> F64:
        """Covariances of the positions, Nx17x3x3."""
        return self.covariance[..., :3, :3]


def predict_joints(states: JointStates, dt_s: float, body_mps: F64) -> None:
    """Predict joints in place after an interval >= 0, given the velocities of the bodies (Nx3)."""
    stays = float(np.exp(-dt_s / LASTS_S))
    F = np.kron(np.array([[1, LASTS_S * (1 - stays)], [0, stays]]), np.eye(3))
    Q = np.kron([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]], np.eye(3))
    body = np.concatenate([0 * body_mps, body_mps], axis=1)[:, None]  # Nx1x6
    noise = AGILITY_MPS2[:, None, None] ** 2 * Q
    mean, states.covariance = predict(states.mean - body, states.covariance, F, noise)
    states.mean = mean + body
    states.mean[..., :3] += dt_s * body_mps[:, None]


def update_points(
    states: JointStates, joints: list[int], points_m: F64, covariances_m2: F64
) -> None:
    """Update joints in place by positions (NxJx3) with covariances (NxJx3x3)."""
    states.mean[:, joints], states.covariance[:, joints] = update(
        states.mean[:, joints], states.covariance[:, joints], points_m, covariances_m2
    )


def update_bones(states: JointStates, bones: Bones, lengths_m: F64, sigma_m: F64) -> None:
    """Update joints in place by lengths of bones (NxK, by kind) with standard deviations."""
    first, second, kind = bones.first, bones.second, bones.kind
    apart_m = states.mean[:, first, :3] - states.mean[:, second, :3]
    distance_m = np.maximum(np.linalg.norm(apart_m, axis=-1), 1e-3)
    unit = (apart_m / distance_m[..., None])[..., None]
    near, far = states.covariance[:, first], states.covariance[:, second]
    near_unit, far_unit = near[..., :3] @ unit, far[..., :3] @ unit
    turned = np.swapaxes(unit, -1, -2)
    spread = (turned @ (near_unit[..., :3, :] + far_unit[..., :3, :]))[..., 0, 0]
    total = spread + sigma_m[:, kind] ** 2
    step = (lengths_m[:, kind] - distance_m) / total
    states.mean[:, first] += step[..., None] * near_unit[..., 0]
    states.mean[:, second] -= step[..., None] * far_unit[..., 0]
    scale = total[..., None, None]
    states.covariance[:, first] = near - near_unit @ np.swapaxes(near_unit, -1, -2) / scale
    states.covariance[:, second] = far - far_unit @ np.swapaxes(far_unit, -1, -2) / scale
