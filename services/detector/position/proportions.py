"""Middle and size of the torso from its proportions, also when some joints are hidden.

Joints are in the order left shoulder, right shoulder, left hip, right hip; docs/method.md section
10.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

from people4d.messages import CameraInfo

# Positions of joints; the mean of simulated women and men of 1.55 to 1.90 m
HALF_SHOULDERS_M = 0.16  # middle of the torso to a shoulder's joint, sideways [m]
HALF_HIPS_M = 0.10  # middle of the torso to a hip's joint, sideways [m]
HALF_HEIGHT_M = 0.25  # middle of the torso to shoulders or hips, 0.288 H / 2 [Winter 2009] [m]


@dataclass(frozen=True, slots=True)
class BodySize:
    """Depth of a person by the size in the image."""

    depth_m: float  # [m] depth at which the largest measure of the torso has the mean size
    farthest_m: float  # [m] depth at which the smallest measure has the mean size
    has_height: bool  # True: height is known; widths alone are foreshortened from the side


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
