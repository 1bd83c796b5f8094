"""Legs that reach their feet, and a pelvis low enough for that."""

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from lab.motion.foot_path import FootPath
from lab.motion.rotations import along
from lab.posture import Skeleton
from people4d.messages import F64

REACH = 0.9985  # of the straight leg: the knee stays bent by 6 degrees
SMOOTH_STEPS = 4  # over which the pelvis is lowered when a foot is out of reach


def lacking_height_m(hip_m: F64, ankle_m: F64, skeleton: Skeleton, side: int) -> F64:
    """Return how far the hip must come down so that the leg reaches the ankle, T, at least 0."""
    length = REACH * sum(_lengths(skeleton, side))
    aside = np.sum((ankle_m - hip_m)[:, :2] ** 2, axis=-1)
    highest = ankle_m[:, 2] + np.sqrt(np.maximum(length**2 - aside, 0.01))
    return np.asarray(np.maximum(hip_m[:, 2] - highest, 0.0))


def smooth_cover(values: F64) -> F64:
    """Return a smooth curve that is nowhere below the values."""
    size = 2 * SMOOTH_STEPS + 1
    cover = maximum_filter1d(values, 2 * size - 1, mode="nearest")
    for _ in range(2):
        cover = uniform_filter1d(cover, size, mode="nearest")
    return np.asarray(cover)


def _lengths(skeleton: Skeleton, side: int) -> tuple[float, float]:
    """Return the lengths of thigh and shank."""
    thigh = skeleton.knee[side] - skeleton.hip[side]
    shank = skeleton.ankle[side] - skeleton.knee[side]
    return float(np.linalg.norm(thigh)), float(np.linalg.norm(shank))


def bend_leg(hip_m: F64, foot: FootPath, forward: F64, skeleton: Skeleton, side: int) -> F64:
    """Return the rotations of thigh and shank that bring the ankle to the foot.

    Args:
        hip_m: Tx3, frame: map.
        foot: Where the ankle shall be.
        forward: Tx3, where the knee points, frame: map.
        skeleton: Of the person.
        side: 0 left, 1 right.

    Returns:
        2xTx3x3, map_from_thigh and map_from_shank.
    """
    thigh, shank = _lengths(skeleton, side)
    leg = foot.ankle_m - hip_m
    distance = np.linalg.norm(leg, axis=-1, keepdims=True)
    axis = leg / distance
    distance = np.clip(distance, abs(thigh - shank) + 0.02, 0.9995 * (thigh + shank))
    lateral = np.cross(forward, axis)
    lateral /= np.linalg.norm(lateral, axis=-1, keepdims=True)
    along_axis = (distance**2 + thigh**2 - shank**2) / (2.0 * distance)
    ahead = np.sqrt(np.maximum(thigh**2 - along_axis**2, 0.0))
    knee = axis * along_axis + np.cross(axis, lateral) * ahead
    left = np.array([0.0, 1.0, 0.0])
    rest = [
        along(skeleton.knee[side] - skeleton.hip[side], left),
        along(skeleton.ankle[side] - skeleton.knee[side], left),
    ]
    return np.stack(
        [
            along(knee, lateral) @ rest[0].T,
            along(axis * distance - knee, lateral) @ rest[1].T,
        ]
    )
