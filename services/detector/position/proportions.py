"""Middle and size of the torso from its proportions, also when some joints are hidden.

Joints are in the order left shoulder, right shoulder, left hip, right hip; docs/method.md section
10.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from people4d.messages import F64, CameraInfo
from services.detector.position.surface import Flags

# Positions of joints; the mean of simulated women and men of 1.55 to 1.90 m
HALF_SHOULDERS_M = 0.16  # middle of the torso to a shoulder's joint, sideways [m]
HALF_HIPS_M = 0.10  # middle of the torso to a hip's joint, sideways [m]
HALF_HEIGHT_M = 0.25  # middle of the torso to shoulders or hips, 0.288 H / 2 [Winter 2009] [m]
SIGMA_LEAN = 0.2  # standard deviation of the downward direction, 1 = 45 degrees, and of stature
SIGMA_TURN = 0.3  # standard deviation of the sideways direction if the yaw is known
UNKNOWN_M2 = 1e12  # variance of an unknown middle [m^2]
# 1, and the distance of each joint to the body's left of its middle and below it
JOINT_OFFSETS: F64 = np.array(
    [
        (1.0, HALF_SHOULDERS_M, -HALF_HEIGHT_M),
        (1.0, -HALF_SHOULDERS_M, -HALF_HEIGHT_M),
        (1.0, HALF_HIPS_M, HALF_HEIGHT_M),
        (1.0, -HALF_HIPS_M, HALF_HEIGHT_M),
    ]
)


@dataclass(frozen=True, slots=True)
class BodySize:
    """Depth of a person by the size in the image."""

    depth_m: float  # [m] depth at which the largest measure of the torso has the mean size
    farthest_m: float  # [m] depth at which the smallest measure has the mean size
    has_height: bool  # True: height is known; widths alone are foreshortened from the side


def torso_middles(
    joints_m: F64, known: Flags, yaws_rad: Sequence[float | None], sigma_m: F64
) -> tuple[F64, F64]:
    """Return the middles of N torsos across the optical axis, Nx2, and their variances, N.

    A joint lies at c + a l + b d; a and b are its position in the body, c is the body's middle, l
    and d are its directions left and down. The known joints give c, l and d by least squares, with
    priors from the yaw and an upright body. With four known joints c is their mean.

    Joints are Nx4x2, to the right and downward at the person's depth, of standard deviations N. If
    no joint (Nx4) is known the variance is UNKNOWN_M2. Yaws are in the camera's body frame.
    """
    # Yaw unknown: the left points cos(yaw) to the right, with mean 0 and variance 1/2.
    turns = [(0.0, 2.0) if yaw is None else (-math.cos(yaw), SIGMA_TURN**-2) for yaw in yaws_rad]
    count, lean = len(turns), SIGMA_LEAN**-2.0
    prior, expected = np.zeros((count, 3, 3)), np.zeros((count, 3, 2))
    prior[:, 0, 0] = 1 / UNKNOWN_M2
    expected[:, 1, 0], prior[:, 1, 1] = np.array(turns).reshape(-1, 2).T
    expected[:, 2, 1], prior[:, 2, 2] = 1.0, lean
    weighted = (known / sigma_m[:, None] ** 2)[:, None] * JOINT_OFFSETS.T  # Nx3x4
    inverse = np.asarray(np.linalg.inv(weighted @ JOINT_OFFSETS + prior), np.float64)
    estimate = inverse @ (weighted @ np.where(known[..., None], joints_m, 0.0) + prior @ expected)
    return estimate[:, 0], inverse[:, 0, 0]


def size_depth(
    joints_px: Sequence[Sequence[float]], known: Sequence[bool], info: CameraInfo
) -> BodySize | None:
    """Return the depth at which a torso has the mean size; None if unknown.

    A foreshortened torso appears smaller, so the largest of its measures counts, unless a joint is
    wrong. Joints are u and v of shoulders and hips.
    """
    shoulders, hips = (list(compress(joints_px[k:], known[k : k + 2])) for k in (0, 2))
    has_height = bool(shoulders and hips)
    measures = [(shoulders, HALF_SHOULDERS_M), (hips, HALF_HIPS_M)]
    # Mean size over size in the image
    depths_per_px = [
        2 * half_m / max(math.dist(*pair), 1.0) for pair, half_m in measures if len(pair) == 2
    ]
    if has_height:
        height_px = max(math.dist(_middle(shoulders), _middle(hips)), 1.0)
        depths_per_px.append(2 * HALF_HEIGHT_M / height_px)
    if not depths_per_px:
        return None
    focal_px = (info.fx + info.fy) / 2
    return BodySize(min(depths_per_px) * focal_px, max(depths_per_px) * focal_px, has_height)


def _middle(joints_px: Sequence[Sequence[float]]) -> list[float]:
    return [sum(axis) / len(joints_px) for axis in zip(*joints_px, strict=True)]
