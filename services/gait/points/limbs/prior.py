"""Expected positions of hands and feet relative to the body.

Expectations are normal distributions in a frame of the body, in statures: a hand at its hip, a foot
below it. With the pixel of a keypoint this gives the depth of a hand behind the torso, or of a foot
behind the other one.

Source: docs/method.md, section 19.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from people4d.messages import F64, CameraInfo
from services.gait.points.body import MeasuredBody, torso_vertices
from services.gait.points.keypoints import LEFT_FOOT, LEFT_HAND, RIGHT_FOOT, RIGHT_HAND
from services.gait.points.normal import Normal

TORSO_HEIGHT = 0.67  # Height of the middle of shoulders and hips [statures]
FRONT_M, SIDE_M = 0.11, 0.16  # Depth of the middle of the torso, in front and side view [m]
HEADING_SIGMA_RAD = 0.3  # Standard deviation of the heading [rad]
JOINT_SIGMA_M = 0.07  # Standard deviation of the keypoint of an elbow or knee [m]


@dataclass(frozen=True)
class LimbModel:
    """Joint of a limb from the torso's middle, and its end from that joint, in statures.

    Vectors are ahead, aside and up. The end moves ahead with its joint by `gain` times the
    distance.
    """

    joint: tuple[float, float, float]
    joint_sigma: tuple[float, float, float]
    end: tuple[float, float, float]
    end_sigma: tuple[float, float, float]
    gain: float


ARM = LimbModel(
    (0.0, 0.137, -0.005), (0.05, 0.03, 0.03), (0.055, 0.02, -0.18), (0.08, 0.035, 0.07), 1.0
)
LEG = LimbModel(
    (0.01, 0.066, -0.367), (0.06, 0.02, 0.02), (-0.015, -0.01, -0.215), (0.1, 0.03, 0.04), 0.0
)
SIDES: Mapping[str, tuple[float, LimbModel]] = MappingProxyType(
    {LEFT_HAND: (1.0, ARM), RIGHT_HAND: (-1.0, ARM), LEFT_FOOT: (1.0, LEG), RIGHT_FOOT: (-1.0, LEG)}
)


def limb_priors(
    body: MeasuredBody,
    heading: F64 | None,
    up: F64,
    joints: Mapping[str, F64],
    info: CameraInfo,
) -> Mapping[str, Normal]:
    """Return the expected positions of hands and feet by name; empty if the heading (3) is None.

    `joints` are the known pixels (u, v) of elbows and knees by the name of the hand or foot.
    """
    if heading is None or body.stature_m <= 0:
        return {}
    axes = np.stack([heading, np.cross(up, heading), up])
    middle_m = _torso_middle(body, heading, up)
    found = {}
    for name, (side, limb) in SIDES.items():
        mirror = np.array((1.0, side, 1.0)) * body.stature_m
        offset = np.array(limb.joint) * mirror
        turned = np.array((-offset[1], offset[0], 0.0)) * HEADING_SIGMA_RAD
        spread = np.diag((np.array(limb.joint_sigma) * body.stature_m) ** 2)
        spread += np.outer(turned, turned)
        joint = Normal(middle_m + offset @ axes, axes.T @ spread @ axes)
        swing = np.eye(3) + limb.gain * np.outer(heading, heading)
        end = np.array(limb.end) * mirror @ axes
        mean_m = joint.mean_m + end
        if name in joints:
            sigma_px = info.fx * JOINT_SIGMA_M / max(float(joint.mean_m[2]), 0.3)
            known = joint.at_pixel(joints[name], sigma_px, info)
            mean_m = joint.mean_m + swing @ (known.mean_m - joint.mean_m) + end
            joint = known
        own = axes.T @ np.diag((np.array(limb.end_sigma) * body.stature_m) ** 2) @ axes
        found[name] = Normal(mean_m, swing @ joint.covariance @ swing.T + own)
    return found


def _torso_middle(body: MeasuredBody, heading: F64, up: F64) -> F64:
    """Return the middle of the torso behind its visible surface."""
    vertices = torso_vertices(body.heights_m, body.stature_m)
    surface_m = np.median(body.mesh.points_m[vertices], axis=0)
    height_m = float(np.median(body.heights_m[vertices]))
    ray = surface_m - (surface_m @ up) * up
    ray /= max(float(np.linalg.norm(ray)), 1e-9)
    along = float(ray @ heading)
    deep_m = float(np.hypot(FRONT_M * along, SIDE_M * np.sqrt(max(1 - along**2, 0.0))))
    return np.asarray(surface_m + deep_m * ray + (TORSO_HEIGHT * body.stature_m - height_m) * up)
