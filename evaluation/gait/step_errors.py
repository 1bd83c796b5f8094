"""Errors of the steps measured by trajectories of feet, against the true steps."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lab.truth.motion_capture import Footfall
from people4d.messages import F64
from services.gait.config import StepConfig
from services.gait.steps.step_meter import FootSample, StepMeter
from services.gait.steps.steps import FootStep, Stride, walked_strides
from services.gait.steps.swings import FEET

NEAR_S = 0.3  # Maximum time between a detected step and the true one [s]
EVERY_S = 0.5  # Period between comparisons [s]
UP = np.array([0.0, 0.0, 1.0])
NOISE_M2 = 0.03**2 * np.eye(3)  # Covariance of a measured foot [m^2]


@dataclass(frozen=True)
class StepErrors:
    """Errors of the steps of one person.

    Args:
        length_m: Of each step, measured minus true.
        means: Nx4, each time that measures were published, measured minus true: step length in m;
            cadence and speed, relative; step time asymmetry, NaN where absent.
        compared: Number of comparisons.
        found: Detected true steps.
        true: True steps.
        extra: False steps.
    """

    length_m: F64
    means: F64
    compared: int
    found: int
    true: int
    extra: int


def compare_steps(
    times_s: F64, feet_m: F64, falls: Sequence[Footfall], covariances_m2: F64 | None = None
) -> StepErrors:
    """Return the errors of steps by trajectories of feet.

    Args:
        times_s: N.
        feet_m: Nx2x3, left and right, frame: map; NaN where a foot was lost.
        falls: The true steps, in order.
        covariances_m2: Nx2x3x3, of the feet; default: covariance of a measured foot.
    """
    if covariances_m2 is None:
        covariances_m2 = np.broadcast_to(NOISE_M2, (*feet_m.shape, 3))
    meter = StepMeter(StepConfig(every_s=1e-3), UP)  # measures of the compared frame
    entire = StepMeter(StepConfig(window_s=600.0), UP)
    means, compared = list[tuple[float, ...]](), 0
    for time_s, feet, noises in zip(times_s.tolist(), feet_m, covariances_m2, strict=True):
        both = [
            FootSample(foot, noise) if np.isfinite(foot).all() else None
            for foot, noise in zip(feet, noises, strict=True)
        ]
        measures = meter.add_frame(time_s, *both)
        entire.add_frame(time_s, *both)
        if time_s < (compared + 1) * EVERY_S:
            continue
        compared += 1
        recent = meter.steps()
        true, steps_per_min = (
            _true(walked_strides(recent), falls),
            _true_cadence(recent, falls),
        )
        if true and steps_per_min and measures.step_length_m and measures.cadence_per_min:
            length_m = measures.step_length_m - true[0]
            cadence = measures.cadence_per_min / steps_per_min - 1
            speed = (measures.walking_speed_mps or np.nan) / (true[0] * steps_per_min / 60) - 1
            uneven = measures.step_time_asymmetry
            means.append((length_m, cadence, speed, np.nan if uneven is None else uneven - true[1]))
    steps = entire.steps()
    known = [(step, k) for step in steps if (k := _match(step, falls)) is not None]
    lengths = [step.length_m - _length_m(falls, k) for step, k in known if 0 < k < len(falls) - 1]
    found = len({k for _, k in known})
    table = np.array(means).reshape(-1, 4)
    return StepErrors(np.array(lengths), table, compared, found, len(falls), len(steps) - found)


def _match(step: FootStep, falls: Sequence[Footfall]) -> int | None:
    """Return the number of the true step of a detected one."""
    side = FEET.index(step.foot)
    near = [
        (abs(fall.time_s - step.landed_s), k)
        for k, fall in enumerate(falls)
        if fall.side == side and abs(fall.time_s - step.landed_s) < NEAR_S
    ]
    return min(near)[1] if near else None


def _length_m(falls: Sequence[Footfall], k: int) -> float:
    """Return the length of a true step along the displacement of the other foot about it."""
    displacement = falls[k + 1].position_m - falls[k - 1].position_m
    displacement = displacement / max(float(np.linalg.norm(displacement)), 1e-9)
    return float((falls[k].position_m - falls[k - 1].position_m) @ displacement)


def _true_cadence(steps: Sequence[FootStep], falls: Sequence[Footfall]) -> float | None:
    """Return the true cadence a minute at the times of detected steps that follow each other."""
    landed_s = np.array([fall.time_s for fall in falls])
    count, time_s = 0, 0.0
    for before, step in pairwise(steps):
        if step.follows and len(falls):
            times_s = [[before.landed_s], [step.landed_s]]
            first, last = np.argmin(np.abs(landed_s - times_s), axis=1).tolist()
            count += last - first
            time_s += float(landed_s[last] - landed_s[first])
    return 60 * count / time_s if count else None


def _true(
    measures: Sequence[tuple[FootStep, Stride]], falls: Sequence[Footfall]
) -> tuple[float, float] | None:
    """Return the true mean step length in m and the step time asymmetry.

    They cover the times of the detected strides; the number of true steps in them shows false and
    merged strides.
    """
    landed_s = np.array([fall.time_s for fall in falls])
    spans = []
    for step, stride in measures:
        times_s = np.array([[step.landed_s - stride.time_s], [step.landed_s]])
        begin, end = np.argmin(np.abs(landed_s - times_s), axis=1).tolist()
        if end > begin:
            spans.append((falls[begin], falls[end - 1], falls[end], end - begin))
    if not spans:
        return None
    count = sum(steps for *_, steps in spans)
    gone_m = sum(
        float(np.linalg.norm(last.position_m - first.position_m)) for first, _, last, _ in spans
    )
    time_s = sum(last.time_s - first.time_s for first, _, last, _ in spans)
    left, right = (
        [last.time_s - other.time_s for _, other, last, _ in spans if last.side == side]
        for side in (0, 1)
    )
    uneven = float(np.mean(left) - np.mean(right)) / (time_s / count) if left and right else 0.0
    return gone_m / count, uneven
