"""The proportions of the torso: where its middle is, also when some joints are hidden.

Joints are in the order left shoulder, right shoulder, left hip, right hip.
"""

import math

import msgspec
import numpy as np
import numpy.typing as npt

from people4d.messages import F64, CameraInfo

BOOL = npt.NDArray[np.bool_]


class ProportionRule(msgspec.Struct, frozen=True, kw_only=True):
    """Where joints are; the mean of the simulated people, women and men of 1.55 to 1.90 m."""

    half_shoulders_m: float = 0.16  # [m] middle of the torso to a shoulder's joint, sideways
    half_hips_m: float = 0.10  # [m] to a hip's joint, sideways
    half_height_m: float = 0.25  # [m] to the shoulders or hips, upright; 0.288 H / 2 (section 6)
    sigma_lean: float = 0.2  # standard deviation of the upright, 1 = 45 deg, and of stature
    sigma_turn: float = 0.3  # of the sideways direction where the way faced is known

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in self.__struct_fields__:
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected a number > 0, got {getattr(self, name)}")

    def places_m(self) -> F64:
        """Return how far each joint lies to the body's left of its middle and below it, 4x2."""
        left = np.array([1, -1, 0, 0]) * self.half_shoulders_m
        left += np.array([0, 0, 1, -1]) * self.half_hips_m
        return np.column_stack([left, np.array([-1, -1, 1, 1]) * self.half_height_m])


def torso_middle(
    joints_m: F64, known: BOOL, yaw_rad: float | None, sigma_m: float, rule: ProportionRule
) -> tuple[F64, float]:
    """Return the torso's middle across the optical axis, and its variance.

    A joint lies at c + a l + b d, a and b its place in the body; c, l and d, the body's middle, its
    left and its down, are estimated from the joints that are known, by least squares. What they do
    not tell comes from the way faced and from an upright body. All four known: c is their mean.

    Args:
        joints_m: 4x2, to the right and downward at the person's depth.
        known: 4, which of them are known, at least one.
        yaw_rad: Way faced in the camera's body frame; None if unknown.
        sigma_m: Standard deviation of a joint.
        rule: Where joints are.
    """
    body = np.column_stack([np.ones(4), rule.places_m()])[known]
    # Any way faced: the left points cos(yaw) to the right, whose mean is 0 and variance a half.
    left, sigma_left = 0.0, math.sqrt(0.5)
    if yaw_rad is not None:
        left, sigma_left = -math.cos(yaw_rad), rule.sigma_turn
    expected = np.array([[0.0, 0.0], [left, 0.0], [0.0, 1.0]])
    prior = np.diag([0.0, sigma_left**-2.0, rule.sigma_lean**-2.0])
    inverse = np.linalg.inv(body.T @ body / sigma_m**2 + prior)
    estimate = inverse @ (body.T @ joints_m[known] / sigma_m**2 + prior @ expected)
    return estimate[0], float(inverse[0, 0])


def size_depth(joints_px: F64, known: BOOL, info: CameraInfo, rule: ProportionRule) -> float | None:
    """Return the depth in metres at which a torso would be of common size; None if unknown.

    What is seen foreshortened looks smaller, so the largest of its measures tells.

    Args:
        joints_px: 4x2, u and v.
        known: 4, which of them are known.
        info: Calibration.
        rule: Common sizes.
    """
    shoulders, hips = joints_px[:2], joints_px[2:]
    shares_m = []  # common size over size in the image
    if known[:2].any() and known[2:].any():
        height = shoulders[known[:2]].mean(axis=0) - hips[known[2:]].mean(axis=0)
        shares_m.append(2 * rule.half_height_m / max(float(np.linalg.norm(height)), 1.0))
    for pair, seen, half_m in (
        (shoulders, known[:2], rule.half_shoulders_m),
        (hips, known[2:], rule.half_hips_m),
    ):
        if seen.all():
            shares_m.append(2 * half_m / max(float(np.linalg.norm(pair[0] - pair[1])), 1.0))
    return min(shares_m) * (info.fx + info.fy) / 2 if shares_m else None
