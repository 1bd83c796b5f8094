"""Gait parameters of a person as used in gait analysis, each with its confidence interval.

Source: docs/method.md, section 20.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.stats import t as student

from people4d.messages import F64
from services.gait.steps.steps import (
    FEET,
    STEP_MAX_S,
    FootStep,
    Side,
    Stride,
    cadence,
    step_times_s,
    walked_strides,
)

LEVEL = 0.95  # Confidence level of the intervals
LIMP_MIN = 5.0  # Minimum asymmetry of a limp [% of the mean step time]
LIMP_CLEAR = 2.5  # Minimum distance of the interval from 0 for a clear limp [%]
# Factor of the interval of the asymmetry of step times: neighbouring pairs share a landing, so the
# variance of their mean is (6 + 2) / 6 of the variance of independent pairs
SHARED = math.sqrt(4 / 3)
UNEVEN_MAX = 0.25  # Maximum deviation from the median step time of a foot for the asymmetry


@dataclass(frozen=True)
class GaitParameter:
    """One parameter of a walk, with the 95 % confidence interval of its mean."""

    name: str
    unit: str
    value: float | None  # mean; None: too few steps
    low: float | None  # lower limit of the interval; None: too few values
    high: float | None
    count: int  # number of values
    definition: str


def gait_parameters(steps: Sequence[FootStep]) -> list[GaitParameter]:
    """Return all parameters of a walk, including unknown ones."""
    walked = walked_strides(steps)
    strides = [stride for _, stride in walked]
    length_m, weights = [one.length_m for one in strides], [one.confidence for one in strides]
    stride_s = np.array([stride.time_s for stride in strides])
    swing_s = np.array([step.landed_s - step.lifted_s for step, _ in walked])
    lengths = {f: [s.length_m for s, _ in walked if s.foot == f] for f in FEET}
    times = {
        f: [one.step_time_s for s, one in walked if s.foot == f and one.step_time_s] for f in FEET
    }
    width = [s.width_m for s, _ in walked if s.width_m is not None]
    swing = 100 * swing_s / stride_s if len(walked) else []
    return [
        _mean("step length", "m", length_m, "half of the stride length", 0.5, weights),
        *(
            _mean(f"{foot} step length", "m", lengths[foot], f"to the {foot} foot, along its path")
            for foot in FEET
        ),
        _mean("stride length", "m", length_m, "between landings of one foot", weights=weights),
        _mean("step width", "m", width, "between both feet, across their path"),
        _cadence(steps),
        _mean("speed", "m/s", [s.length_m / s.time_s for s in strides], "stride length by time"),
        _share("stance", 100 - np.asarray(swing), "of the stride, the foot is on the ground"),
        _share("swing", swing, "of the stride, the foot is in the air"),
        _share("double support", _double_support(steps), "of the stride, on both feet"),
        _time_asymmetry(walked, times),
    ]


def limping_side(parameters: Sequence[GaitParameter]) -> str | None:
    """Return the spared foot by the asymmetry of step times; None if unclear.

    A person stands on a painful foot for a shorter time, so the other foot's step is shorter in
    time.
    """
    one = next(p for p in parameters if p.name == "step time asymmetry")
    if one.value is None or one.low is None or one.high is None or abs(one.value) < LIMP_MIN:
        return None
    if one.low > LIMP_CLEAR:
        return "left"
    return "right" if one.high < -LIMP_CLEAR else None


def recognisable_limp(parameters: Sequence[GaitParameter]) -> float | None:
    """Return the minimum recognisable asymmetry of step times [%].

    It follows from the interval for this number of steps; None if unknown.
    """
    one = next(p for p in parameters if p.name == "step time asymmetry")
    if one.low is None or one.high is None:
        return None
    return max(LIMP_MIN, LIMP_CLEAR + (one.high - one.low) / 2)


def _mean(
    name: str,
    unit: str,
    values: Sequence[float] | F64,
    definition: str,
    scale: float = 1.0,
    weights: Sequence[float] | None = None,
) -> GaitParameter:
    """Return the mean with Student's interval, by the effective number of weighted values."""
    known = scale * np.asarray(values, np.float64)
    count = len(known)
    shares = np.ones(count) if weights is None else np.asarray(weights, np.float64)
    if not count:
        return GaitParameter(name, unit, None, None, None, 0, definition)
    mean, half = float(np.average(known, weights=shares)), None
    if count > 1:
        variance = float(np.average((known - mean) ** 2, weights=shares)) * count / (count - 1)
        error = math.sqrt(variance * float(shares @ shares)) / float(shares.sum())
        half = float(student.ppf(0.5 + LEVEL / 2, count - 1)) * error
    low, high = (None, None) if half is None else (mean - half, mean + half)
    return GaitParameter(name, unit, mean, low, high, count, definition)


def _share(name: str, values: Sequence[float] | F64, definition: str) -> GaitParameter:
    """Return the mean of shares in %, whose interval is within 0 to 100."""
    one = _mean(name, "%", values, definition)
    if one.low is None or one.high is None:
        return one
    return replace(one, low=max(one.low, 0.0), high=min(one.high, 100.0))


def _cadence(steps: Sequence[FootStep]) -> GaitParameter:
    """Return the cadence, with the relative interval of the mean step time."""
    one = _mean("cadence", "1/min", np.asarray(step_times_s(steps)) / 60, "steps a minute")
    value, time = cadence(steps), one.value
    low, high = (
        None if value is None or not time or edge is None or edge <= 0 else value * time / edge
        for edge in (one.high, one.low)
    )
    return replace(one, value=value, low=low, high=high)


def _time_asymmetry(
    walked: Sequence[tuple[FootStep, Stride]], times: Mapping[Side, Sequence[float]]
) -> GaitParameter:
    """Return (left - right) / mean of step times with Student's interval over pairs of steps.

    A late landing makes a step longer and the next one shorter, so errors of steps are correlated,
    errors of pairs hardly. Steps far from the median of their foot are turns or wrong landings.
    """
    middles = {foot: float(np.median(values)) for foot, values in times.items() if len(values)}
    pairs: list[tuple[float, float]] = []
    last: tuple[FootStep, float] | None = None
    for step, stride in walked:
        time_s = stride.step_time_s
        if time_s is None or abs(time_s / middles[step.foot] - 1) > UNEVEN_MAX:
            last = None
        elif last is not None and last[0].foot != step.foot and _follows(last[0], step, time_s):
            pairs.append((last[1], time_s) if step.foot == "right" else (time_s, last[1]))
            last = None
        else:
            last = step, time_s
    table = np.array(pairs).reshape(-1, 2)
    mean_s = float(table.mean()) if len(pairs) else 1.0
    definition = "of step times: left less right, by their mean; above 0: left ones are longer"
    one = _mean("step time asymmetry", "%", 100 * (table[:, 0] - table[:, 1]) / mean_s, definition)
    if one.value is None or one.low is None or one.high is None:
        return replace(one, value=None)
    half = SHARED * (one.high - one.low) / 2
    return replace(one, low=one.value - half, high=one.value + half)


def _follows(before: FootStep, step: FootStep, time_s: float) -> bool:
    """Check that a step with its time begins at the landing of another one."""
    return math.isclose(step.landed_s - time_s, before.landed_s, abs_tol=1e-6)


def _double_support(steps: Sequence[FootStep]) -> list[float]:
    """Return the share of each stride, in %, between landings of a foot and lifts of the other."""
    shared = {
        id(step): max(step.lifted_s - before.landed_s, 0.0)
        for before, step in pairwise(steps)
        if before.foot != step.foot
    }
    return [
        100 * (shared[id(before)] + shared[id(step)]) / step.stride.time_s
        for before, step in pairwise(steps)
        if step.stride
        and id(before) in shared
        and id(step) in shared
        and step.stride.time_s <= 2 * STEP_MAX_S
    ]
