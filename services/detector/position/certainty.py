"""How sure a position is: the covariance of a measurement from the errors of depth and pixels.

A stereo camera measures disparity, so its error in depth grows with the square of the distance. To
that come the body itself, whose axis lies not exactly where the model has it, and the joints, which
a network places with an error that grows with the person in the image.
"""

import math

import msgspec
import numpy as np

from people4d.messages import F64, CameraInfo
from services.detector.position.trunk import TrunkRule


class CertaintyRule(msgspec.Struct, frozen=True, kw_only=True):
    """Standard deviations; depth as of a D435i, the others from the simulated room."""

    depth_per_m: float = 0.0036  # [1/m] of a reading, over z^2: 0.07 px of disparity, 385 px, 50 mm
    body_m: float = 0.035  # [m] along the line of sight: bodies, clothes, arms before the trunk
    joint_m: float = 0.04  # [m] across: a joint, of near people
    joint_px: float = 2.0  # [px] across: a joint, of far people
    # Centroids of masks and means of keypoints, from the torso, where nothing else is known:
    centroid_m: float = 0.04  # [m] across
    centroid_down_m: float = 0.2  # [m] downward
    surface_m: float = 0.16  # [m] along: the surface, where it is not corrected

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in self.__struct_fields__:
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected a number > 0, got {getattr(self, name)}")


def along_m2(z_m: float, readings_m: F64, unsure_m: float, rule: CertaintyRule) -> float:
    """Return the variance along the line of sight of the mean of N readings.

    Args:
        z_m: Depth of the person.
        readings_m: N, what independent readings tell of the depth.
        unsure_m: Standard deviation that all readings share besides that of the body.
        rule: How sure readings and bodies are.
    """
    count = len(readings_m)
    sensor_m2 = (rule.depth_per_m * z_m**2) ** 2 / count
    spread_m2 = float(readings_m.var(ddof=1)) / count if count > 1 else 0.0
    return sensor_m2 + spread_m2 + rule.body_m**2 + unsure_m**2


def axis_sigma(trunk: TrunkRule | None, yaw_rad: float | None, rule: CertaintyRule) -> float:
    """Return the standard deviation, in metres, of how far the axis lies behind the surface.

    With the way faced unknown that goes from a to b and back like a sine: (b - a) / sqrt(8).

    Args:
        trunk: Size of the body by which positions are moved to the axis; None: they are not.
        yaw_rad: Way faced; None if unknown.
        rule: How far the surface is from the axis.
    """
    if trunk is None:
        return rule.surface_m
    return 0.0 if yaw_rad is not None else abs(trunk.half_width_m - trunk.half_depth_m) / 8**0.5


def joint_m(z_m: float, info: CameraInfo, rule: CertaintyRule) -> float:
    """Return the standard deviation of a joint's place across the line of sight."""
    return math.hypot(rule.joint_m, rule.joint_px * z_m / info.fx)


def covariance(position_m: F64, right_m2: float, down_m2: float, along_m2: float) -> F64:
    """Return the 3x3 covariance of a position, optical frame.

    Args:
        position_m: 3, the position, which gives the line of sight.
        right_m2: Variance across it, to the right.
        down_m2: Variance across it, downward.
        along_m2: Variance along it.
    """
    ray = position_m / np.linalg.norm(position_m)
    right = np.array([ray[2], 0.0, -ray[0]]) / math.hypot(ray[0], ray[2])
    axes = np.column_stack([right, np.cross(ray, right), ray])
    turned: F64 = (axes * (right_m2, down_m2, along_m2)) @ axes.T
    return (turned + turned.T) / 2  # exactly symmetric
