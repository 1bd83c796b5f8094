"""Correction from the body's surface to its axis, and the covariance of positions.

Depth is measured on the side of a person facing the camera. The axis of the torso, an upright
ellipse, is behind it: less from the front, more from the side. A stereo camera measures disparity,
so its error in depth grows with the square of the distance; the errors of the ellipse and of the
joints are added (docs/method.md section 10).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from people4d.messages import F64, CameraInfo


class Ellipse(NamedTuple):
    """Cross section of a torso."""

    half_depth_m: float  # [m] axis to chest
    half_width_m: float  # [m] axis to side, arms included


# Half the chest depth, and half the mean of shoulder and hip breadth, of adults, without clothes
BODY = Ellipse(half_depth_m=0.125, half_width_m=0.205)
# Standard deviations of positions, from simulated people
BODY_M = 0.035  # bodies, clothes and arms, along the line of sight [m]
JOINT_PX = 2.0  # joint of a far person, across the line of sight [px]
CENTROID_M = 0.04  # centroid of a mask or mean of keypoints from the torso, to the right [m]
CENTROID_DOWN_M = 0.2  # centroid from the torso, downward [m]
SURFACE_M = 0.16  # positions on the surface, along the line of sight [m]


def surface_to_axis(relative_rad: float | None, ellipse: Ellipse) -> float:
    """Return the distance from the surface in front of the axis to the axis, in metres.

    The ellipse (p.f)^2 / a^2 + (p.l)^2 / b^2 = 1, f and l the unit vectors forward and to the left
    of the person, a and b half its depth and width, solved for the side that faces the camera.

    Args:
        relative_rad: Yaw from the line of sight, 0 = facing away, + to the left; None if it is
            unknown: then the torso is a circle of the same area.
        ellipse: Cross section.
    """
    a, b = ellipse
    if relative_rad is None:
        return math.sqrt(a * b)
    return 1 / math.hypot(math.cos(relative_rad) / a, math.sin(relative_rad) / b)


def move_to_axis(position_m: F64, yaw_rad: float | None, ellipse: Ellipse) -> F64:
    """Return the position on the axis behind a point on the surface; yaw in the camera's frame."""
    behind_m = surface_to_axis(relative_yaw(position_m, yaw_rad), ellipse)
    moved: F64 = position_m * (1 + behind_m / math.hypot(position_m[0], position_m[2]))
    return moved


def relative_yaw(position_m: F64, yaw_rad: float | None) -> float | None:
    """Return the yaw from the line of sight to a position in the optical frame."""
    return None if yaw_rad is None else yaw_rad - math.atan2(-position_m[0], position_m[2])


def axis_sigma(ellipse: Ellipse | None, yaw_rad: float | None) -> float:
    """Return the standard deviation, in metres, of the distance from the surface to the axis.

    If the yaw is unknown the distance varies from a to b and back like a sine: (b - a) / sqrt(8).
    Without an ellipse positions stay on the surface.
    """
    if ellipse is None:
        return SURFACE_M
    return 0.0 if yaw_rad is not None else abs(ellipse.half_width_m - ellipse.half_depth_m) / 8**0.5


def variance_along(
    z_m: float, readings_m: Sequence[float], sigma_m: float, depth_error_per_m: float
) -> float:
    """Return the variance, in m^2, of the mean of N readings along the line of sight.

    `sigma_m` is common to all; the error of a single reading is `depth_error_per_m` z^2.
    """
    count = len(readings_m)
    sensor_m2 = (depth_error_per_m * z_m**2) ** 2 / count
    mean_m, pairs = sum(readings_m) / count, max(count * (count - 1), 1)
    spread_m2 = sum((reading_m - mean_m) ** 2 for reading_m in readings_m) / pairs
    return sensor_m2 + spread_m2 + BODY_M**2 + sigma_m**2


def variances_across(z_m: float, info: CameraInfo) -> tuple[float, float]:
    """Return the variances, in m^2, of a centroid to the right and downward."""
    pixel_m2 = (JOINT_PX * z_m / info.fx) ** 2
    return CENTROID_M**2 + pixel_m2, CENTROID_DOWN_M**2 + pixel_m2


def covariance(
    position_m: Sequence[float], right_m2: float, down_m2: float, along_m2: float
) -> F64:
    """Return the 3x3 covariance of a position from variances across and along its line of sight.

    The frame is optical; `right_m2` and `down_m2` are across the line of sight.
    """
    # Plain floats: arrays take five times as long for one position.
    length_m = math.hypot(*position_m)
    x, y, z = (coordinate / length_m for coordinate in position_m)
    level = math.hypot(x, z)
    right_x, right_z = z / level, -x / level
    down_x, down_y, down_z = y * right_z, z * right_x - x * right_z, -y * right_x  # ray x right
    xy = down_m2 * down_x * down_y + along_m2 * x * y
    xz = right_m2 * right_x * right_z + down_m2 * down_x * down_z + along_m2 * x * z
    yz = down_m2 * down_y * down_z + along_m2 * y * z
    return np.array(
        [
            [right_m2 * right_x**2 + down_m2 * down_x**2 + along_m2 * x**2, xy, xz],
            [xy, down_m2 * down_y**2 + along_m2 * y**2, yz],
            [xz, yz, right_m2 * right_z**2 + down_m2 * down_z**2 + along_m2 * z**2],
        ]
    )
