"""Middle and size of the torso from its proportions, also when some joints are hidden.

Joints are in the order left shoulder, right shoulder, left hip, right hip; docs/method.md section
10.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from people4d.messages import F64, CameraInfo
from services.detector.config import ProportionConfig

Flags = npt.NDArray[np.bool_]
UNKNOWN_M2 = 1e12  # [m^2]


@dataclass(frozen=True, slots=True)
class BodySize:
    """Depth of a person by the size in the image."""

    depth_m: float  # [m] depth at which the largest measure of the torso would be of common size
    farthest_m: float  # [m] depth at which the smallest measure would be
    has_height: bool  # by its height too; widths alone are foreshortened from the side


@cache
def joint_offsets(config: ProportionConfig) -> F64:
    """Return 1, and how far each joint lies to the body's left of its middle and below it, 4x3."""
    left = np.array([1, -1, 0, 0]) * config.half_shoulders_m
    left += np.array([0, 0, 1, -1]) * config.half_hips_m
    return np.column_stack([np.ones(4), left, np.array([-1, -1, 1, 1]) * config.half_height_m])


def torso_middles(
    joints_m: F64,
    known: Flags,
    yaws_rad: Sequence[float | None],
    sigma_m: F64,
    config: ProportionConfig,
) -> tuple[F64, F64]:
    """Return the middles of N torsos across the optical axis, Nx2, and their variances, N.

    A joint lies at c + a l + b d, a and b its position in the body; c, l and d, the body's middle,
    its left and its down, are estimated from the known joints by least squares, with priors from
    the yaw and an upright body. All four known: c is their mean.

    Joints are Nx4x2, to the right and downward at the person's depth, of standard deviations N; of
    a person with none known (Nx4) the variance is UNKNOWN_M2. Yaws are in the camera's body frame.
    """
    # Yaw unknown: the left points cos(yaw) to the right, whose mean is 0 and variance a half.
    turns = [
        (0.0, 2.0) if yaw is None else (-math.cos(yaw), config.sigma_turn**-2) for yaw in yaws_rad
    ]
    count, lean = len(turns), config.sigma_lean**-2.0
    prior, expected = np.zeros((count, 3, 3)), np.zeros((count, 3, 2))
    prior[:, 0, 0] = 1 / UNKNOWN_M2
    expected[:, 1, 0], prior[:, 1, 1] = np.array(turns).reshape(-1, 2).T
    expected[:, 2, 1], prior[:, 2, 2] = 1.0, lean
    body = joint_offsets(config)
    weighted = (known / sigma_m[:, None] ** 2)[:, None] * body.T  # Nx3x4
    inverse = np.asarray(np.linalg.inv(weighted @ body + prior), np.float64)
    estimate = inverse @ (weighted @ np.where(known[..., None], joints_m, 0.0) + prior @ expected)
    return estimate[:, 0], inverse[:, 0, 0]


def size_depth(
    joints_px: F64, known: Flags, info: CameraInfo, config: ProportionConfig
) -> BodySize | None:
    """Return the depth at which a torso would be of common size; None if unknown.

    A foreshortened torso appears smaller, so the largest of its measures counts, unless a joint is
    wrong. Joints are 4x2, u and v.
    """
    is_known = known.tolist()
    shoulders = [joint for joint, use in zip(joints_px[:2].tolist(), is_known, strict=False) if use]
    hips = [joint for joint, use in zip(joints_px[2:].tolist(), is_known[2:], strict=True) if use]
    has_height = bool(shoulders and hips)
    measures = [(shoulders, config.half_shoulders_m), (hips, config.half_hips_m)]
    # Common size over size in the image
    depths_per_px = [
        2 * half_m / max(math.dist(*pair), 1.0) for pair, half_m in measures if len(pair) == 2
    ]
    if has_height:
        height_px = max(math.dist(_middle(shoulders), _middle(hips)), 1.0)
        depths_per_px.append(2 * config.half_height_m / height_px)
    if not depths_per_px:
        return None
    focal_px = (info.fx + info.fy) / 2
    return BodySize(min(depths_per_px) * focal_px, max(depths_per_px) * focal_px, has_height)


def _middle(joints_px: Sequence[Sequence[float]]) -> list[float]:
    return [sum(axis) / len(joints_px) for axis in zip(*joints_px, strict=True)]
