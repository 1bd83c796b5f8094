"""Steps, strides and gait measures by the swings of both feet.

Lengths are means over strides, weighted by their confidence. Both ends of a stride are the same
part of the same foot; of two feet, toes and heel may be visible. The cadence is the rate of
confident steps that follow each other, and of unseen steps between them.

Source: docs/method.md, section 20.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from people4d.messages import F64, GaitMeasures
from services.gait.steps.alternation import STEP_MAX_S, STEP_MIN_S, Landing, find_landings
from services.gait.steps.stances import LENGTH_MIN_M
from services.gait.steps.swings import FEET, FootTrajectory, Side, Swing, find_swings

CONFIDENCE_MIN = 0.3  # Minimum confidence of a reported step
SPEED_MIN_MPS = 0.2  # Minimum speed of a walking person [m/s]
TIME_SPREAD = (
    0.5  # Maximum relative deviation of the time of a stride from the median; longer: a pause
)
JUMP_M, JUMP_S = 0.15, 0.25  # Maximum length [m] and time [s] of a motion that is no step
STEPS_MIN = 2  # Minimum number of steps for the cadence; of each foot for the asymmetry
CERTAIN = 0.7  # Minimum confidence of a step that continues a walk
STEPS_APART_MAX = 16  # Maximum number of steps between the landings of a pair for the cadence
UNOBSERVED = 0.3  # Confidence of an unseen step
CONFIDENCE_LEAST = 0.01  # Minimum confidence of a stride


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
    lifted_s: float  # time at which the foot left its last footprint; last landing if unseen
    position_m: tuple[float, float]  # position on the ground
    # Distance from the other foot, across the walking direction; None if not visible
    width_m: float | None
    confidence: float  # 0 to 1
    follows: bool = False  # True if the other foot made the previous step in the list
    observed: bool = True  # False if two steps of the other foot enclose the time of this one


def find_steps(left: FootTrajectory, right: FootTrajectory, up: F64) -> list[FootStep]:
    """Return the steps of a person in the order of time; none while standing.

    Trajectories contain measured and predicted positions; `up` (3, unit) points up.
    """
    swings = [
        one
        for one in find_swings(left, right, up)
        if one.confidence >= CONFIDENCE_MIN and not _is_brief(one)
    ]
    found: list[FootStep] = []
    for landing in find_landings(swings):
        if landing.steps > 1:
            found += _unobserved(found[-1], landing)
        found.append(_step(found, landing))
    return found


def _is_brief(swing: Swing) -> bool:
    """Check for a short motion that does not pass the other foot: a jumping or sliding point."""
    length_m, _ = _from_other_m(swing)
    return length_m < JUMP_M and swing.landed_s - swing.lifted_s < JUMP_S


def _from_other_m(swing: Swing) -> tuple[float, float | None]:
    """Return the distance from the other foot along the swing, and across it if visible."""
    direction, apart = (swing.to_m - swing.from_m) / swing.length_m, swing.to_m - swing.other_m
    if not np.isfinite(apart).all():
        return swing.length_m / 2, None
    across = float(apart[1] * direction[0] - apart[0] * direction[1])
    return float(apart @ direction), abs(across)


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
    return [float(time_s) for part in _walks(steps) for time_s in np.diff(part)]


def cadence(steps: Sequence[FootStep]) -> float | None:
    """Return the steps a minute; None with fewer than two consecutive steps.

    The time of a step is the median over all pairs of landings in each part of the walk, robust to
    an early or late landing [Theil 1950] [Sen 1968]. An uncertain step begins another part, since
    feet also move in turns and stops; it counts if there are no other steps.
    """
    times_s: list[float] = []
    for part in _walks(steps):
        landed_s = np.array(part)
        for apart in range(1, min(len(part), STEPS_APART_MAX + 1)):
            times_s += ((landed_s[apart:] - landed_s[:-apart]) / apart).tolist()
    # One step time gives one pair of landings; N step times give at least N pairs.
    time_s = float(np.median(times_s)) if len(times_s) >= STEPS_MIN else 0.0
    return 60 / time_s if time_s > 0 else None


def _walks(steps: Sequence[FootStep]) -> list[list[float]]:
    """Return the times of landings that follow each other, by part of the walk.

    Parts contain confident steps, or all steps if too few are confident.
    """
    certain = _parts(steps, CERTAIN)
    enough = sum(map(len, certain)) - len(certain) >= STEPS_MIN
    return certain if enough else _parts(steps, 0.0)


def _parts(steps: Sequence[FootStep], confidence_min: float) -> list[list[float]]:
    """Return the times of landings that follow each other, by part of the walk.

    An observed step of less confidence begins another part.
    """
    parts: list[list[float]] = []
    for step in steps:
        certain = step.confidence >= confidence_min or not step.observed
        if not (step.follows and certain and parts):
            parts.append([])
        parts[-1].append(step.landed_s)
    return parts


def walked_strides(steps: Sequence[FootStep]) -> list[tuple[FootStep, Stride]]:
    """Return the strides without pauses by their time, including short strides of turns."""
    known = [(step, step.stride) for step in steps if step.stride]
    if not known:
        return []
    times_s = np.array([stride.time_s for _, stride in known])
    off = np.abs(times_s / np.quantile(times_s, 0.5, method="higher") - 1)
    return [one for one, spread in zip(known, off, strict=True) if spread <= TIME_SPREAD]


def _step(before: Sequence[FootStep], landing: Landing) -> FootStep:
    swing = landing.swing
    length_m, width_m = _from_other_m(swing)
    step = FootStep(
        foot=FEET[landing.side],
        landed_s=swing.landed_s,
        length_m=length_m,
        stride=None,
        lifted_s=swing.lifted_s,
        position_m=(float(swing.to_m[0]), float(swing.to_m[1])),
        width_m=width_m,
        confidence=swing.confidence,
        follows=landing.steps > 0,
    )
    return replace(step, stride=_stride(before, step))


def _unobserved(before: FootStep, landing: Landing) -> list[FootStep]:
    """Return the unobserved steps between two landings, at equal intervals."""
    last, after = before, landing.swing
    ratios = [k / landing.steps for k in range(1, landing.steps)]
    found = []
    for ratio in ratios:
        landed_s = before.landed_s + ratio * (after.landed_s - before.landed_s)
        there_m = (1 - ratio) * np.array(before.position_m) + ratio * after.to_m
        last = FootStep(
            foot=FEET[1 - FEET.index(last.foot)],
            landed_s=landed_s,
            length_m=float(np.linalg.norm(after.to_m - before.position_m)) / landing.steps,
            stride=None,
            lifted_s=last.landed_s,
            position_m=(float(there_m[0]), float(there_m[1])),
            width_m=None,
            confidence=UNOBSERVED,
            follows=True,
            observed=False,
        )
        found.append(last)
    return found


def _stride(before: Sequence[FootStep], step: FootStep) -> Stride | None:
    """Return the stride that ends with a step; None unless this foot landed two steps before."""
    if len(before) < 2 or not (step.follows and before[-1].follows and before[-2].observed):
        return None
    other, own = before[-1], before[-2]
    time_s, length_m = step.landed_s - own.landed_s, math.dist(step.position_m, own.position_m)
    if not 2 * STEP_MIN_S <= time_s <= 2 * STEP_MAX_S:
        return None
    if length_m < max(LENGTH_MIN_M, SPEED_MIN_MPS * time_s):
        return None
    confidence = max(min(step.confidence, own.confidence), CONFIDENCE_LEAST)
    step_time_s = step.landed_s - other.landed_s if other.observed else None
    return Stride(length_m, time_s, step_time_s, confidence)
