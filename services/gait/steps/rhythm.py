"""Rhythm of a walk by the distance between both feet, which is longest at each landing.

It needs no single landing, nor which foot is which, so it gives the cadence where a few landings
are early or late, as in short walks with stops.

Source: docs/method.md, section 20.
"""

import math
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.gait.steps.swings import FootTrajectory

WINDOW_S, HOP_S = 4.0, 1.0  # in which the frequency is constant
SAMPLES_MIN = 12  # of a window
NOISE_M = 0.05  # of the distance of feet, besides that of their points
RATIOS = np.arange(0.88, 1.14, 0.01)  # of the cadence by landings, that are looked at
SUPPORT_MIN = 60.0  # squared deviations that a rhythm explains in a window, at least
INFLATION = 1.3  # of the standard deviation of the frequency: no walk is a pure sine


@dataclass(frozen=True)
class FeetDistance:
    """Level distance between both feet over time."""

    times_s: F64  # N
    distance_m: F64  # N
    variance_m2: F64  # N


def feet_distance(left: FootTrajectory, right: FootTrajectory, up: F64) -> FeetDistance:
    """Return the level distance of both feet at the times that both have."""
    times_s, *both = np.intersect1d(left.times_s, right.times_s, return_indices=True)
    level = np.eye(3) - np.outer(up, up)
    apart_m = (left.points_m[both[0]] - right.points_m[both[1]]) @ level
    covariance_m2 = left.covariances_m2[both[0]] + right.covariances_m2[both[1]]
    distance_m = np.linalg.norm(apart_m, axis=1)
    along = apart_m / np.maximum(distance_m, 1e-3)[:, None]
    variance_m2 = np.einsum("ni,nij,nj->n", along, covariance_m2, along) + NOISE_M**2
    return FeetDistance(times_s, distance_m, variance_m2)


def with_rhythm(step_s: float, sigma_s: float, feet: FeetDistance) -> float:
    """Return the time of a step by landings and their standard deviation, improved by the rhythm.

    The mean of both, each weighted by its variance.
    """
    if len(feet.times_s) < SAMPLES_MIN:
        return step_s
    steps_hz = RATIOS / step_s
    support, window_s = _support(feet, steps_hz)
    best = int(np.argmax(support))
    if support[best] < SUPPORT_MIN or best in (0, len(RATIOS) - 1):
        return step_s
    # Least standard deviation of a frequency [Rife 1974]
    sigma_hz = INFLATION * math.sqrt(12 / support[best]) / (2 * math.pi * window_s)
    by_rhythm = (steps_hz[best] / sigma_hz) ** 2, 1 / steps_hz[best]
    by_landings = (step_s / sigma_s) ** 2, step_s
    weights, values = zip(by_rhythm, by_landings, strict=True)
    return float(np.average(values, weights=weights))


def _support(feet: FeetDistance, steps_hz: F64) -> tuple[F64, float]:
    """Return how well a sine of each frequency explains the distance, and the windows' length.

    By least squares in windows of some seconds, each with its own amplitude, mean and slope: the
    squared deviations that the sine explains, the mean of all windows.
    """
    begin_s, end_s = float(feet.times_s[0]), float(feet.times_s[-1])
    window_s = min(WINDOW_S, end_s - begin_s)
    found = []
    for start_s in np.arange(begin_s, end_s - window_s + 1e-6, HOP_S):
        inside = (feet.times_s >= start_s) & (feet.times_s <= start_s + window_s)
        if inside.sum() < SAMPLES_MIN:
            continue
        times_s = feet.times_s[inside] - start_s - window_s / 2
        angles = 2 * np.pi * np.outer(steps_hz, times_s)
        trend = np.stack([np.ones_like(times_s), times_s])[None]
        sine = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        both = np.concatenate([np.repeat(trend, len(sine), axis=0), sine], axis=1)
        weights, values = 1 / feet.variance_m2[inside], feet.distance_m[inside]
        found.append(_explained(both, weights, values) - _explained(trend, weights, values))
    return (np.mean(found, axis=0) if found else np.zeros(len(steps_hz))), window_s


def _explained(design: F64, weights: F64, values: F64) -> F64:
    """Return the weighted squares of N values that models explain, FxKxN."""
    weighted = design * weights
    right = weighted @ values
    normal = weighted @ np.swapaxes(design, -1, -2)
    return np.asarray((right * np.linalg.solve(normal, right[..., None])[..., 0]).sum(axis=-1))
