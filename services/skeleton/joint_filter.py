"""Kalman filters of joints: position and velocity of each, for all people at once.

Joints are filtered apart; a bone between two of them is a measurement of their distance.
"""

from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.skeleton.body import Bones

UNKNOWN_M2 = 1e4  # variance of what is not measured


@dataclass
class JointStates:
    """State of N people's joints in a fixed frame."""

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


def predict(
    states: JointStates, dt_s: float, body_mps: F64, lasts_s: float, agility_mps2: F64
) -> None:
    """Move joints on by a time.

    Args:
        states: Are changed.
        dt_s: Time, not negative.
        body_mps: Nx3, velocities of the bodies.
        lasts_s: Time constant with which a joint's motion against its body ends.
        agility_mps2: 17, white noise of accelerations.
    """
    stays = float(np.exp(-dt_s / lasts_s))
    moves_s = lasts_s * (1 - stays)
    relative = states.mean[..., 3:] - body_mps[:, None]
    states.mean[..., :3] += dt_s * body_mps[:, None] + moves_s * relative
    states.mean[..., 3:] = body_mps[:, None] + stays * relative
    transition = np.eye(6)
    transition[:3, 3:] = np.eye(3) * moves_s
    transition[3:, 3:] *= stays
    noise = np.kron([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]], np.eye(3))
    states.covariance = (
        transition @ states.covariance @ transition.T + agility_mps2[:, None, None] ** 2 * noise
    )


def update_points(
    states: JointStates, joints: list[int], points_m: F64, covariances_m2: F64
) -> None:
    """Measure positions of some joints: NxJx3 with covariances NxJx3x3; states are changed."""
    covariance = states.covariance[:, joints]
    sums = covariance[..., :3, :3] + covariances_m2
    gain = covariance[..., :3] @ np.linalg.inv(sums)
    innovation = points_m - states.mean[:, joints, :3]
    states.mean[:, joints] += (gain @ innovation[..., None])[..., 0]
    covariance -= gain @ covariance[..., :3, :]
    states.covariance[:, joints] = (covariance + np.swapaxes(covariance, -1, -2)) / 2


def update_bones(states: JointStates, bones: Bones, lengths_m: F64, sigma_m: F64) -> None:
    """Measure lengths of bones (NxK, by kind) with standard deviations; states are changed."""
    first, second, kind = list(bones.first), list(bones.second), list(bones.kind)
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
