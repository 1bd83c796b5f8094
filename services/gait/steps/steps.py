"""Steps, strides and gait measures by the walk of body and feet.

Lengths are means over strides, weighted by their confidence. Both ends of a stride are the same
part of the same foot; of two feet, toes and heel may be visible. The cadence is the rate of steps
that follow each other.

Source: docs/method.md, section 20.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt

from people4d.messages import F64, GaitMeasures
from services.gait.steps.walk import ASIDE_M, LIFT, Walk, WalkSamples, fit_walk

Side = Literal["left", "right"]
FEET: tuple[Side, Side] = ("left", "right")
GAP_S = 1.0  # Maximum time between frames of a walk [s]
FRAMES_MIN = 4  # Minimum number of frames of a walk
STANCE = (0.03, LIFT - 0.05)  # Range of the phase of a standing foot after its landing
SWING = (-0.35, 0.15)  # Searched range of the phase about a landing
APPROACH = (0.7, 0.92)  # Range of the approach to a footprint [lengths of the swing]
APPROACH_FRAMES = 3  # Minimum number of samples of a foot about its landing
SETTLED = 0.1  # Minimum phase between a landing and the first and last frame
LANDING_S = 0.25  # Maximum time between a landing by the walk and by the approach [s]
LENGTH_MIN_M = 0.2  # Minimum length of a stride [m]
SPEED_MIN_MPS = 0.2  # Minimum speed of a walking person [m/s]
STEP_MIN_S, STEP_MAX_S = 0.3, 1.5  # Range of half the time of a stride [s]
PAUSE = 1.6  # Minimum time of a step with a pause [halves of the median stride]
STEPS_MIN = 2  # Minimum number of steps for the cadence; of each foot for the asymmetry
STEPS_APART_MAX = 16  # Maximum number of steps between the landings of a pair for the cadence
UNOBSERVED = 0.3  # Confidence of a step of a hidden foot
UNOBSERVED_MAX = 1  # Maximum number of unobserved steps from an observed one


@dataclass(frozen=True)
class PointTrajectory:
    """Positions of a point of a person, measured or predicted."""

    times_s: F64  # N, rising
    points_m: F64  # Nx3, in a fixed frame, z up
    covariances_m2: F64  # Nx3x3, covariances of the points


@dataclass(frozen=True)
class Stride:
    """Motion of a foot from one footprint to its next."""

    length_m: float  # distance between the footprints
    time_s: float  # time between the landings
    step_time_s: float | None  # time since the landing of the other foot; None if unseen
    confidence: float = 1.0  # minimum confidence of both footprints, > 0


@dataclass(frozen=True)
class FootStep:
    """Landing of a foot."""

    foot: Side
    landed_s: float
    length_m: float  # distance from the other foot, in walking direction
    stride: Stride | None  # stride that ends here; None if its beginning was not detected
    lifted_s: float  # time at which the foot left its last footprint
    position_m: tuple[float, float]  # position on the ground
    # Distance from the other foot, across the walking direction; None if not visible
    width_m: float | None
    confidence: float  # 0 to 1
    follows: bool = False  # True if the other foot made the previous step in the list
    observed: bool = True  # False if the foot was not visible where it stood


def find_steps(
    body: PointTrajectory, left: PointTrajectory, right: PointTrajectory
) -> list[FootStep]:
    """Return the steps of a person in the order of time; none while standing."""
    times_s = np.unique(np.concatenate([one.times_s for one in (body, left, right)]))
    begin_s, end_s = body.times_s[[0, -1]] if len(body.times_s) else (0.0, -1.0)
    times_s = times_s[(times_s >= begin_s) & (times_s <= end_s)]
    found: list[FootStep] = []
    for part in np.split(times_s, np.flatnonzero(np.diff(times_s) > GAP_S) + 1):
        if len(part) >= FRAMES_MIN:
            found += _walk_steps(_samples(part, body, (left, right)))
    return found


def _samples(times_s: F64, body: PointTrajectory, feet: Sequence[PointTrajectory]) -> WalkSamples:
    """Return the body, interpolated, and the feet at some times."""
    points_m = np.full((len(times_s), 2, 2), np.nan)
    covariances_m2 = np.tile(np.eye(2), (len(times_s), 2, 1, 1))
    for foot, one in enumerate(feet):
        rows = np.flatnonzero(np.isin(times_s, one.times_s))
        known = np.isin(one.times_s, times_s)
        points_m[rows, foot] = one.points_m[known, :2]
        covariances_m2[rows, foot] = one.covariances_m2[known, :2, :2]
    middle = [np.interp(times_s, body.times_s, body.points_m[:, k]) for k in range(2)]
    return WalkSamples(times_s, np.stack(middle, axis=1), points_m, covariances_m2)


def _walk_steps(samples: WalkSamples) -> list[FootStep]:
    """Return the landings of a walk: a foot lands each half of a phase."""
    walk = fit_walk(samples)
    highest = np.maximum.accumulate(walk.phases)
    first, last = int(2 * (highest[0] + SETTLED)) + 1, int(2 * (highest[-1] - SETTLED))
    landed = [_landing(samples, walk, highest, count) for count in range(first, last + 1)]
    return _linked(_halved(_supported(sorted(landed, key=lambda one: one.landed_s))))


def _supported(steps: Sequence[FootStep]) -> list[FootStep]:
    """Return observed steps, and unobserved ones at most UNOBSERVED_MAX away."""
    known = np.flatnonzero([step.observed for step in steps])
    if not len(known):
        return []
    near = [np.abs(known - k).min() <= UNOBSERVED_MAX for k in range(len(steps))]
    return [step for step, one in zip(steps, near, strict=True) if one]


def _linked(steps: Sequence[FootStep]) -> list[FootStep]:
    """Return steps with their strides; a pause is longer than half of the median stride."""
    landed_s = np.array([step.landed_s for step in steps])
    times_s, strides_s = np.diff(landed_s), landed_s[2:] - landed_s[:-2]
    walked_s = strides_s[strides_s < 2 * STEP_MAX_S]
    longest_s = PAUSE / 2 * float(np.median(walked_s)) if len(walked_s) else STEP_MAX_S
    found: list[FootStep] = []
    for k, step in enumerate(steps):
        one = replace(step, follows=k > 0 and bool(times_s[k - 1] <= longest_s))
        found.append(replace(one, stride=_stride(found, one)))
    return found


def _halved(steps: Sequence[FootStep]) -> list[FootStep]:
    """Return steps with unobserved ones halfway between observed steps of the other foot."""
    found = list(steps)
    for k, (before, one, after) in enumerate(zip(steps, steps[1:], steps[2:], strict=False), 1):
        apart_s = after.landed_s - before.landed_s
        if one.observed or not (before.observed and after.observed) or apart_s > 2 * STEP_MAX_S:
            continue
        length_m = math.dist(before.position_m, after.position_m) / 2
        found[k] = replace(one, landed_s=before.landed_s + apart_s / 2, length_m=length_m)
        found[k + 1] = replace(after, length_m=length_m)
    return found


def _landing(samples: WalkSamples, walk: Walk, highest: F64, count: int) -> FootStep:
    """Return the landing at a phase of count / 2, not linked to others."""
    phase, foot = count / 2, count % 2
    landed_s, lifted_s = (
        _crossing_s(samples.times_s, highest, level) for level in (phase, phase - 1 + LIFT)
    )
    nearest = int(np.argmin(np.abs(samples.times_s - landed_s)))
    heading = walk.headings[nearest]
    across = heading[::-1] * (-1.0, 1.0)
    position_m = _footprint_m(samples, walk.phases - phase, foot)
    observed = position_m is not None
    if position_m is None:
        aside_m = ASIDE_M if foot == 0 else -ASIDE_M
        position_m = walk.body_m[nearest] + walk.lengths_m[nearest] / 2 * heading + aside_m * across
    else:
        landed_s = _landed_s(samples, walk.phases - phase, foot, position_m, landed_s)
    other_m = _footprint_m(samples, walk.phases - phase + 0.5, 1 - foot)
    length_m, width_m = float(walk.lengths_m[nearest]), None
    if observed and other_m is not None:
        apart_m = position_m - other_m
        length_m, width_m = float(apart_m @ heading), abs(float(apart_m @ across))
    return FootStep(
        foot=FEET[foot],
        landed_s=landed_s,
        length_m=length_m,
        stride=None,
        lifted_s=min(lifted_s, landed_s),
        position_m=(float(position_m[0]), float(position_m[1])),
        width_m=width_m,
        confidence=_confidence(samples, walk.phases - phase, foot) if observed else UNOBSERVED,
        observed=observed,
    )


def _footprint_m(samples: WalkSamples, after: F64, foot: int) -> F64 | None:
    """Return the mean position of a standing foot; None if it is not visible.

    `after` is the phase of each frame since its landing.
    """
    stands = np.isfinite(samples.feet_m[:, foot, 0]) & _within(after, STANCE)
    if not stands.any():
        return None
    information = samples.information[stands, foot]
    weighted = np.einsum("nij,nj->i", information, samples.feet_m[stands, foot])
    return np.linalg.solve(information.sum(axis=0), weighted)


def _landed_s(samples: WalkSamples, after: F64, foot: int, to_m: F64, default_s: float) -> float:
    """Return the time at which a foot reaches its footprint, near the time by the walk."""
    path = np.isfinite(samples.feet_m[:, foot, 0]) & _within(after, SWING)
    if np.count_nonzero(path) < APPROACH_FRAMES:
        return default_s
    from_m = _footprint_m(samples, after + 1, foot)
    path_m = samples.feet_m[path, foot]
    from_m = path_m[0] if from_m is None else from_m
    landed_s = _approach_s(samples.times_s[path], path_m, from_m, to_m)
    return landed_s if abs(landed_s - default_s) < LANDING_S else default_s


def _confidence(samples: WalkSamples, after: F64, foot: int) -> float:
    """Return the share of frames with a visible foot from its lift to the end of its stance."""
    visible = np.isfinite(samples.feet_m[_within(after, (LIFT - 1, STANCE[1])), foot, 0])
    return float(np.clip(visible.mean(), UNOBSERVED, 1.0))


def _within(values: F64, limits: tuple[float, float]) -> npt.NDArray[np.bool_]:
    return (values >= limits[0]) & (values <= limits[1])


def _crossing_s(times_s: F64, values: F64, level: float) -> float:
    """Return the time at which rising values reach a level, within the known times."""
    k = int(np.searchsorted(values, level - 1e-9))
    if k == 0 or k == len(values):
        return float(times_s[min(k, len(values) - 1)])
    ratio = (level - values[k - 1]) / max(values[k] - values[k - 1], 1e-9)
    return float(times_s[k - 1] + ratio * (times_s[k] - times_s[k - 1]))


def _approach_s(times_s: F64, path_m: F64, from_m: F64, to_m: F64) -> float:
    """Return the time at which a foot reaches its footprint at its speed of approach.

    The end of the path itself is uncertain, since its speed is as small as its noise.
    """
    swing_m = to_m - from_m
    length_m2 = max(float(swing_m @ swing_m), 1e-9)
    along = np.maximum.accumulate((path_m - from_m) @ swing_m / length_m2)
    far_s, near_s = (_crossing_s(times_s, along, edge) for edge in APPROACH)
    return near_s + (1.0 - APPROACH[1]) / (APPROACH[1] - APPROACH[0]) * (near_s - far_s)


def gait_measures(steps: Sequence[FootStep]) -> GaitMeasures:
    """Return the measures of a walk; the number of steps alone without a known stride."""
    walked = walked_strides(steps)
    cadence_per_min = cadence(steps)
    if not walked or cadence_per_min is None:
        return GaitMeasures(steps=len(steps))
    sizes = np.array([(stride.length_m, stride.confidence) for _, stride in walked])
    length_m = float(np.average(sizes[:, 0], weights=sizes[:, 1]))
    asymmetry = None
    left, right = (
        [one.step_time_s for step, one in walked if step.foot == foot and one.step_time_s]
        for foot in FEET
    )
    if min(len(left), len(right)) >= STEPS_MIN:
        asymmetry = float(np.median(left) - np.median(right)) * cadence_per_min / 60
    return GaitMeasures(
        steps=len(steps),
        step_length_m=length_m / 2,
        stride_length_m=length_m,
        cadence_per_min=cadence_per_min,
        walking_speed_mps=length_m / 2 * cadence_per_min / 60,
        step_time_asymmetry=asymmetry,
    )


def step_times_s(steps: Sequence[FootStep]) -> list[float]:
    """Return the times [s] of the steps by which the cadence is estimated."""
    return [
        (after.landed_s - before.landed_s) / (j - i)
        for part in _parts(steps)
        for (i, before), (j, after) in pairwise(part)
    ]


def cadence(steps: Sequence[FootStep]) -> float | None:
    """Return the steps a minute; None with fewer than two consecutive steps.

    The time of a step is the median over all pairs of observed landings in each part of the walk,
    robust to an early or late landing [Theil 1950] [Sen 1968].
    """
    times_s = [
        (after.landed_s - before.landed_s) / (j - i)
        for part in _parts(steps)
        for (i, before), (j, after) in combinations(part, 2)
        if j - i <= STEPS_APART_MAX
    ]
    # One step time gives one pair of landings; N step times give at least N pairs.
    time_s = float(np.median(times_s)) if len(times_s) >= STEPS_MIN else 0.0
    return 60 / time_s if time_s > 0 else None


def _parts(steps: Sequence[FootStep]) -> list[list[tuple[int, FootStep]]]:
    """Return the observed steps with their numbers by part of the walk, without pauses."""
    parts: list[list[tuple[int, FootStep]]] = []
    for number, step in enumerate(steps):
        if not (parts and step.follows):
            parts.append([])
        if step.observed:
            parts[-1].append((number, step))
    return parts


def walked_strides(steps: Sequence[FootStep]) -> list[tuple[FootStep, Stride]]:
    """Return the steps that end a stride, each with its stride."""
    return [(step, step.stride) for step in steps if step.stride]


def _stride(before: Sequence[FootStep], step: FootStep) -> Stride | None:
    """Return the stride that ends with a step; None unless this foot landed two steps before."""
    if len(before) < 2 or not (step.follows and before[-1].follows):
        return None
    if not (step.observed and before[-2].observed):
        return None
    other, own = before[-1], before[-2]
    time_s, length_m = step.landed_s - own.landed_s, math.dist(step.position_m, own.position_m)
    if not 2 * STEP_MIN_S <= time_s <= 2 * STEP_MAX_S:
        return None
    if length_m < max(LENGTH_MIN_M, SPEED_MIN_MPS * time_s):
        return None
    confidence = min(step.confidence, own.confidence)
    step_time_s = step.landed_s - other.landed_s if other.observed else None
    return Stride(length_m, time_s, step_time_s, confidence)
