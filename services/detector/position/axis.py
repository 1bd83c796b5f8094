"""From the surface to the axis of the body, and the covariance of positions there.

Depth is read on the side of a person that faces the camera. The axis of the torso, an upright
ellipse, lies behind it: little from the front, more from the side, where arm and shoulder come
first. A stereo camera measures disparity, so its error in depth grows with the square of the
distance; to that come the error of the ellipse and that of the joints (docs/method.md section 10).
"""

import math

import numpy as np

from people4d.messages import F64, CameraInfo
from services.detector.config import EllipseConfig, UncertaintyConfig

RIM = 0.9  # of the half width: nearer to the outline the surface falls away too steeply to be used


def surface_to_axis(right_m: F64, relative_rad: float | None, config: EllipseConfig) -> F64:
    """Return the distance from the surface to the axis, along the line of sight.

    The ellipse (p.f)^2 / a^2 + (p.l)^2 / b^2 = 1, f and l the unit vectors forward and to the left
    of the person, a and b half its depth and width, solved for the side that faces the camera.

    Args:
        right_m: N points on the surface, to the right of the axis, in metres.
        relative_rad: Yaw from the line of sight, 0 = facing away, + to the left; None if it is
            unknown: then the torso is taken to be as deep as wide, of the same area.
        config: Cross section.
    """
    a, b = config.half_depth_m, config.half_width_m
    if relative_rad is None:
        relative_rad, a, b = 0.0, math.sqrt(a * b), math.sqrt(a * b)
    sine, cosine = math.sin(relative_rad), math.cos(relative_rad)
    xx = (sine / a) ** 2 + (cosine / b) ** 2
    yy = (cosine / a) ** 2 + (sine / b) ** 2
    xy = sine * cosine * (a**-2 - b**-2)
    reach_m = RIM * a * b * math.sqrt(yy)
    x = np.clip(right_m, -reach_m, reach_m)
    depth_m: F64 = (np.sqrt((xy * x) ** 2 - yy * (xx * x**2 - 1)) - xy * x) / yy
    return depth_m


def move_to_axis(position_m: F64, yaw_rad: float | None, config: EllipseConfig) -> F64:
    """Return the position on the axis behind a point on the surface; yaw in the camera's frame."""
    behind_m = surface_to_axis(np.zeros(1), relative_yaw(position_m, yaw_rad), config)[0]
    moved: F64 = position_m * (1 + behind_m / math.hypot(position_m[0], position_m[2]))
    return moved


def relative_yaw(position_m: F64, yaw_rad: float | None) -> float | None:
    """Return the yaw from the line of sight to a position in the optical frame."""
    return None if yaw_rad is None else yaw_rad - math.atan2(-position_m[0], position_m[2])


def axis_sigma(
    ellipse: EllipseConfig | None, yaw_rad: float | None, config: UncertaintyConfig
) -> float:
    """Return the standard deviation, in metres, of the distance from the surface to the axis.

    With the yaw unknown that goes from a to b and back like a sine: (b - a) / sqrt(8). Without an
    ellipse positions stay on the surface.
    """
    if ellipse is None:
        return config.surface_m
    return 0.0 if yaw_rad is not None else abs(ellipse.half_width_m - ellipse.half_depth_m) / 8**0.5


def joint_sigma(z_m: F64, info: CameraInfo, config: UncertaintyConfig) -> F64:
    """Return the standard deviations, in metres, of joints across the line of sight."""
    return np.hypot(config.joint_m, config.joint_px * z_m / info.fx)


def variance_along(z_m: float, readings_m: F64, sigma_m: float, config: UncertaintyConfig) -> float:
    """Return the variance, in m^2, of the mean of N readings along the line of sight.

    All share `sigma_m`.
    """
    count = len(readings_m)
    sensor_m2 = (config.depth_per_m * z_m**2) ** 2 / count
    spread_m2 = float(readings_m.var(ddof=1)) / count if count > 1 else 0.0
    return sensor_m2 + spread_m2 + config.body_m**2 + sigma_m**2


def covariance(position_m: F64, right_m2: float, down_m2: float, along_m2: float) -> F64:
    """Return the 3x3 covariance of a position from variances across and along its line of sight.

    All in the optical frame; `right_m2` and `down_m2` are those across it.
    """
    # Numbers of Python: np.cross takes ten times as long for one vector.
    x, y, z = (position_m / np.linalg.norm(position_m)).tolist()
    level = math.hypot(x, z)
    right_x, right_z = z / level, -x / level
    down = y * right_z, z * right_x - x * right_z, -y * right_x  # the ray x the right
    axes = np.array([[right_x, down[0], x], [0.0, down[1], y], [right_z, down[2], z]])
    rotated: F64 = (axes * (right_m2, down_m2, along_m2)) @ axes.T
    return (rotated + rotated.T) / 2  # exactly symmetric
