"""Middle and size of the torso from its proportions, also when some joints are hidden.

Joints are in the order left shoulder, right shoulder, left hip, right hip; docs/method.md section
10.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from people4d.messages import F64, CameraInfo
from services.detector.config import ProportionConfig

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class BodySize:
    """Depth of a person by the size in the image."""

    depth_m: float  # [m] depth at which the largest measure of the torso would be of common size
    farthest_m: float  # [m] depth at which the smallest measure would be
    has_height: bool  # by its height too; widths alone are foreshortened from the side


def joint_offsets(config: ProportionConfig) -> F64:
    """Return how far each joint lies to the body's left of its middle and below it, 4x2."""
    left = np.array([1, -1, 0, 0]) * config.half_shoulders_m
    left += np.array([0, 0, 1, -1]) * config.half_hips_m
    return np.column_stack([left, np.array([-1, -1, 1, 1]) * config.half_height_m])


def torso_middle(
    joints_m: F64, known: Flags, yaw_rad: float | None, sigma_m: float, config: ProportionConfig
) -> tuple[F64, float]:
    """Return the torso's middle across the optical axis, and its variance.

    A joint lies at c + a l + b d, a and b its position in the body; c, l and d, the body's middle,
    its left and its down, are estimated from the known joints by least squares, with priors from
    the yaw and an upright body. All four known: c is their mean.

    Joints are 4x2, to the right and downward at the person's depth, of a standard deviation; at
    least one is known. The yaw is in the camera's body frame.
    """
    body = np.column_stack([np.ones(4), joint_offsets(config)])[known]
    # Yaw unknown: the left points cos(yaw) to the right, whose mean is 0 and variance a half.
    left, sigma_left = 0.0, math.sqrt(0.5)
    if yaw_rad is not None:
        left, sigma_left = -math.cos(yaw_rad), config.sigma_turn
    expected = np.array([[0.0, 0.0], [left, 0.0], [0.0, 1.0]])
    prior = np.diag([0.0, sigma_left**-2.0, config.sigma_lean**-2.0])
    inverse = np.linalg.inv(body.T @ body / sigma_m**2 + prior)
    estimate = inverse @ (body.T @ joints_m[known] / sigma_m**2 + prior @ expected)
    return estimate[0], float(inverse[0, 0])


def size_depth(
    joints_px: F64, known: Flags, info: CameraInfo, config: ProportionConfig
) -> BodySize | None:
    """Return the depth at which a torso would be of common size; None if unknown.

    A foreshortened torso appears smaller, so the largest of its measures counts, unless a joint is
    wrong. Joints are 4x2, u
    and v.
    """
    shoulders, hips = joints_px[:2], joints_px[2:]
    has_height = bool(known[:2].any() and known[2:].any())
    depths_per_px = []  # common size over size in the image
    if has_height:
        height = shoulders[known[:2]].mean(axis=0) - hips[known[2:]].mean(axis=0)
        depths_per_px.append(2 * config.half_height_m / max(float(np.linalg.norm(height)), 1.0))
    for pair, both, half_m in (
        (shoulders, known[:2], config.half_shoulders_m),
        (hips, known[2:], config.half_hips_m),
    ):
        if both.all():
            depths_per_px.append(2 * half_m / max(float(np.linalg.norm(pair[0] - pair[1])), 1.0))
    if not depths_per_px:
        return None
    focal_px = (info.fx + info.fy) / 2
    return BodySize(min(depths_per_px) * focal_px, max(depths_per_px) * focal_px, has_height)
