"""From the surface that depth shows to the axis of the body: the trunk as an upright ellipse.

Depth is read on the side of a person that faces the camera. How far the axis lies behind it depends
on the way the person is turned: little from the front, more from the side, where arm and shoulder
come first.
"""

import math

import msgspec
import numpy as np

from people4d.messages import F64

RIM = 0.9  # of the way to the outline: nearer to it the surface falls away too steeply to be used


class TrunkRule(msgspec.Struct, frozen=True, kw_only=True):
    """Size of the trunk; adults differ by about a tenth.

    Source: half the chest depth, and half the mean of shoulder and hip breadth, of men and women as
    anthropometric surveys have them (about 0.25, 0.47 and 0.34 m); clothes are not counted.
    """

    half_depth_m: float = 0.125  # [m] axis to chest
    half_width_m: float = 0.205  # [m] axis to side, arms included

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in ("half_depth_m", "half_width_m"):
            if not 0 < getattr(self, name) <= 1:
                raise ValueError(f"{name}: expected above 0 to 1, got {getattr(self, name)}")


def surface_to_axis(across_m: F64, turned_rad: float | None, rule: TrunkRule) -> F64:
    """Return how far the axis lies behind the surface, along the line of sight.

    The ellipse (p.f)^2 / a^2 + (p.l)^2 / b^2 = 1, f and l the unit vectors forward and to the left
    of the person, solved for the side that faces the camera.

    Args:
        across_m: N places on the surface, to the right of the axis, in metres.
        turned_rad: Way faced from the line of sight, 0 = facing away, + to the left; None if it is
            unknown: then the trunk is taken to be as deep as wide, of the same section.
        rule: Size of the trunk; a is its half depth, b its half width.

    Returns:
        N in metres.
    """
    a, b = rule.half_depth_m, rule.half_width_m
    if turned_rad is None:
        turned_rad, a, b = 0.0, math.sqrt(a * b), math.sqrt(a * b)
    sine, cosine = math.sin(turned_rad), math.cos(turned_rad)
    xx = (sine / a) ** 2 + (cosine / b) ** 2
    yy = (cosine / a) ** 2 + (sine / b) ** 2
    xy = sine * cosine * (a**-2 - b**-2)
    reach_m = RIM * a * b * math.sqrt(yy)
    x = np.clip(across_m, -reach_m, reach_m)
    depth_m: F64 = (np.sqrt((xy * x) ** 2 - yy * (xx * x**2 - 1)) - xy * x) / yy
    return depth_m


def move_to_axis(position_m: F64, yaw_rad: float | None, rule: TrunkRule) -> F64:
    """Return the axis behind a point of the surface that is seen before it.

    Args:
        position_m: 3, optical frame.
        yaw_rad: Way faced in the camera's body frame (0 = along its axis, + to the left), or None.
        rule: Size of the trunk.
    """
    behind_m = surface_to_axis(np.zeros(1), turned(position_m, yaw_rad), rule)[0]
    moved: F64 = position_m * (1 + behind_m / math.hypot(position_m[0], position_m[2]))
    return moved


def turned(position_m: F64, yaw_rad: float | None) -> float | None:
    """Return the way faced, counted from the line of sight to a position in the optical frame."""
    return None if yaw_rad is None else yaw_rad - math.atan2(-position_m[0], position_m[2])
