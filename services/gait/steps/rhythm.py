"""Rhythm of a walk: feet are farthest apart, and the head is lowest, at each landing.

It needs no single landing and no names of feet, so it gives the cadence if landings are few, early
or late, as in short walks with stops or with feet that are mostly hidden.

Source: docs/method.md, section 20.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.gait.steps.swings import FootTrajectory

WINDOW_S, HOP_S = 4.0, 1.0  # Windows of constant frequency: length, and distance [s]
SAMPLES_MIN = 12  # Minimum number of samples of a window
NOISE_M = 0.05  # Noise of the distance of feet, in addition to the noise of their points [m]
HEIGHT_M = 0.015  # Noise of the height of the head [m]
RATIOS = np.arange(0.88, 1.14, 0.01)  # Candidates of the cadence [cadences by landings]
SUPPORT_MIN = 60.0  # Minimum of squared deviations that a rhythm explains in a window
INFLATION = 1.3  # Factor of the standard deviation of the frequency: no walk is a pure sine


@dataclass(frozen=True)
class Oscillation:
    """Quantity that oscillates with each step."""

    times_s: F64  # N
    values_m: F64  # N
    variances_m2: F64  # N


def feet_distance(left: FootTrajectory, right: FootTrajectory, up: F64) -> Oscillation:
    """Return the level distance of both feet at the times that both have."""
    times_s, *both = np.intersect1d(left.times_s, right.times_s, return_indices=True)
    level = np.eye(3) - np.outer(up, up)
    apart_m = (left.points_m[both[0]] - right.points_m[both[1]]) @ level
    covariance_m2 = left.covariances_m2[both[0]] + right.covariances_m2[both[1]]
    distance_m = np.linalg.norm(apart_m, axis=1)
    along = apart_m / np.maximum(distance_m, 1e-3)[:, None]
    variance_m2 = np.einsum("ni,nij,nj->n", along, covariance_m2, along) + NOISE_M**2
    return Oscillation(times_s, distance_m, variance_m2)


def head_height(times_s: F64, points_m: F64, up: F64) -> Oscillation:
    """Return the height of the head, Nx3 points."""
    return Oscillation(times_s, points_m @ up, np.full(len(times_s), HEIGHT_M**2))


def with_rhythm(step_s: float, sigma_s: float, rhythm: Sequence[Oscillation]) -> float:
    """Return the time of a step by landings and their standard deviation, improved by the rhythm.

    The mean of both, each weighted by its variance.
    """
    steps_hz = RATIOS / step_s
    support = sum((_support(one, steps_hz) for one in rhythm), np.zeros(len(RATIOS)))
    best = int(np.argmax(support))
    if support[best] < SUPPORT_MIN or best in (0, len(RATIOS) - 1):
        return step_s
    # Least standard deviation of a frequency [Rife 1974]
    sigma_hz = INFLATION * math.sqrt(12 / support[best]) / (2 * math.pi * WINDOW_S)
    by_rhythm = (steps_hz[best] / sigma_hz) ** 2, 1 / steps_hz[best]
    by_landings = (step_s / sigma_s) ** 2, step_s
    weights, values = zip(by_rhythm, by_landings, strict=True)
    return float(np.average(values, weights=weights))


def _support(one: Oscillation, steps_hz: F64) -> F64:
    """Return how well a sine of each frequency explains an oscillation.

    By least squares in windows of some seconds, each with its own amplitude, mean and slope: the
    squared deviations that the sine explains, the mean of all windows.
    """
    found = []
    span_s = float(np.ptp(one.times_s)) if len(one.times_s) else 0.0
    for start_s in one.times_s[:1] + np.arange(0, span_s - WINDOW_S + 1e-6, HOP_S):
        inside = (one.times_s >= start_s) & (one.times_s <= start_s + WINDOW_S)
        if inside.sum() < SAMPLES_MIN:
            continue
        times_s = one.times_s[inside] - start_s - WINDOW_S / 2
        angles = 2 * np.pi * np.outer(steps_hz, times_s)
        trend = np.stack([np.ones_like(times_s), times_s])[None]
        sine = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        both = np.concatenate([np.repeat(trend, len(sine), axis=0), sine], axis=1)
        weights, values = 1 / one.variances_m2[inside], one.values_m[inside]
        found.append(_explained(both, weights, values) - _explained(trend, weights, values))
    return np.asarray(np.mean(found, axis=0)) if found else np.zeros(len(steps_hz))


def _explained(design: F64, weights: F64, values: F64) -> F64:
    """Return the weighted squares of N values that models explain, FxKxN."""
    weighted = design * weights
    right = weighted @ values
    normal = weighted @ np.swapaxes(design, -1, -2)
    return np.asarray((right * np.linalg.solve(normal, right[..., None])[..., 0]).sum(axis=-1))
