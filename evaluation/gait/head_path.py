"""Sway and turns of a person by the path of the head.

Source: docs/method.md, section 20.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from people4d.messages import F64
from services.gait.steps.steps import FootStep

SMOOTH_S = 0.3  # Standard deviation of the smoothing of the path of the head for turns [s]
TURN_RADPS, TURN_MIN_RAD = math.radians(15.0), math.radians(45.0)
MOVING_MPS = 0.15  # Minimum speed of a path with a known direction [m/s]
RATE_HZ = 20.0  # Rate of the resampled path [Hz]
SWAY_MIN, PATH_MIN_M = 5, 0.1  # Minimum samples and path [m] of a stride with known sway


@dataclass(frozen=True)
class HeadPath:
    """Path of the head from above."""

    times_s: F64  # N, rising
    ground_m: F64  # Nx2


def sway_m(head: HeadPath, steps: Sequence[FootStep]) -> list[float]:
    """Return half of the range of the head across its path in each stride."""
    found = []
    for step in steps:
        if step.stride is None:
            continue
        half_s = step.stride.time_s / 2
        begins, ends = (
            np.searchsorted(head.times_s, head.times_s + off) for off in (-half_s, half_s)
        )
        inside = (head.times_s >= step.landed_s - 2 * half_s) & (head.times_s <= step.landed_s)
        inside &= (head.times_s >= head.times_s[0] + half_s) & (
            head.times_s <= head.times_s[-1] - half_s
        )
        if inside.sum() < SWAY_MIN:
            continue
        total = np.concatenate([np.zeros((1, 2)), np.cumsum(head.ground_m, axis=0)])
        path = (total[ends] - total[begins]) / np.maximum(ends - begins, 1)[:, None]
        off, path = (head.ground_m - path)[inside], path[inside]
        along = path[-1] - path[0]
        length_m = float(np.linalg.norm(along))
        if length_m > PATH_MIN_M:
            across = off @ (np.array([-along[1], along[0]]) / length_m)
            found.append(float(np.quantile(across, 0.95) - np.quantile(across, 0.05)) / 2)
    return found


def turn_durations_s(head: HeadPath) -> list[float]:
    """Return the durations of turns: faster than 15 degrees a second, 45 degrees in all."""
    if len(head.times_s) < 3 or head.times_s[-1] - head.times_s[0] < 1.0:
        return []
    times_s = np.arange(head.times_s[0], head.times_s[-1], 1 / RATE_HZ)
    ground = np.stack([np.interp(times_s, head.times_s, c) for c in head.ground_m.T], axis=1)
    ground = gaussian_filter1d(ground, SMOOTH_S * RATE_HZ, axis=0, mode="nearest")
    velocity = np.gradient(ground, 1 / RATE_HZ, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    rate = np.gradient(heading, 1 / RATE_HZ)
    found = []
    for sign in (1.0, -1.0):
        turning = (sign * rate > TURN_RADPS) & (speed > MOVING_MPS)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], turning, [0]])))
        for begin, end in edges.reshape(-1, 2).tolist():
            if sign * (heading[end - 1] - heading[begin]) >= TURN_MIN_RAD:
                found.append((begin, (end - begin) / RATE_HZ))
    return [duration_s for _, duration_s in sorted(found)]
