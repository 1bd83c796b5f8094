"""Steps, strides and gait measures by footprints.

Three consecutive footprints are a stride if the middle one, of the other foot, lies halfway; with a
footprint missed between them it does not. Measures are means over strides: both ends of a stride
are the same foot, while of two feet the toes of one may be visible and the heel of the other.

Source: docs/method.md, section 20.
"""

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from people4d.messages import F64, GaitMeasures
from services.gait.config import StepConfig
from services.gait.steps.footprints import Footprint, FootTrajectory, find_footprints

HALFWAY = (0.38, 0.62)  # of a stride; with a footprint missed, the next is at two thirds
IN_TIME = (0.3, 0.7)  # the same of its time: a limp delays one foot
IN_AIR_MAX = 0.25  # of a step, in which neither foot seems to stand
STEPS_MIN = 2  # of each foot, for the asymmetry

Side = Literal["left", "right"]
FEET: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True)
class Stride:
    """Motion of a foot from one footprint to its next."""

    length_m: float  # between the footprints
    time_s: float  # between the landings
    step_time_s: float  # since the landing of the other foot


@dataclass(frozen=True)
class FootStep:
    """Landing of a foot."""

    foot: Side
    landed_s: float
    length_m: float  # from the other foot, in walking direction
    stride: Stride | None  # that ended here; None if its begin was not detected


def find_steps(
    left: FootTrajectory, right: FootTrajectory, up: F64, config: StepConfig
) -> list[FootStep]:
    """Return the steps of a person in the order of time; none while standing.

    Trajectories are of measured positions only; `up` (3, unit) points away from the ground.
    """
    footprints = find_footprints(left, right, up, config)
    steps: dict[int, FootStep] = {}
    triples = zip(footprints, footprints[1:], footprints[2:], strict=False)
    for k, (first, other, last) in enumerate(triples):
        if _is_stride(first, other, last, config):
            before, step = _steps(first, other, last)
            steps.setdefault(k, before)  # unless it ended a stride
            steps[k + 1] = step
    return list(steps.values())


def gait_measures(steps: Sequence[FootStep], config: StepConfig) -> GaitMeasures:
    """Return the measures of a walk; empty if there are too few even strides."""
    even = even_strides(steps, config)
    if len(even) < config.strides_min:
        return GaitMeasures()
    length_m = float(np.mean([stride.length_m for _, stride in even]))
    time_s = float(np.mean([stride.time_s for _, stride in even]))
    asymmetry = None
    left, right = ([one.step_time_s for step, one in even if step.foot == foot] for foot in FEET)
    if min(len(left), len(right)) >= STEPS_MIN:
        asymmetry = float(np.mean(left) - np.mean(right)) / (time_s / 2)
    return GaitMeasures(
        steps=len(even),
        step_length_m=length_m / 2,
        stride_length_m=length_m,
        cadence_per_min=2 * 60 / time_s,
        walking_speed_mps=length_m / time_s,
        step_time_asymmetry=asymmetry,
    )


def even_strides(steps: Sequence[FootStep], config: StepConfig) -> list[tuple[FootStep, Stride]]:
    """Return the strides near the median: without starts, stops and turns."""
    known = [(step, step.stride) for step in steps if step.stride]
    if not known:
        return []
    sizes = np.array([(stride.length_m, stride.time_s) for _, stride in known])
    off = np.abs(sizes / np.median(sizes, axis=0) - 1)
    even = (off <= (config.length_spread, config.time_spread)).all(axis=1)
    return [one for one, is_even in zip(known, even, strict=True) if is_even]


def _is_stride(first: Footprint, other: Footprint, last: Footprint, config: StepConfig) -> bool:
    """Check that a foot moved from the first footprint to the last, past the other foot."""
    displacement = last.ground_m - first.ground_m
    length_m, time_s = float(np.linalg.norm(displacement)), last.landed_s - first.landed_s
    if not 2 * config.step_min_s <= time_s <= 2 * config.step_max_s:
        return False
    if length_m < max(2 * config.length_min_m, config.speed_min_mps * time_s):
        return False
    halfway = float((other.ground_m - first.ground_m) @ displacement) / length_m**2
    in_time = (other.landed_s - first.landed_s) / time_s
    in_air_s = max(other.landed_s - first.lifted_s, last.landed_s - other.lifted_s)
    return (
        HALFWAY[0] <= halfway <= HALFWAY[1]
        and IN_TIME[0] <= in_time <= IN_TIME[1]
        and in_air_s <= IN_AIR_MAX * time_s / 2
    )


def _steps(first: Footprint, other: Footprint, last: Footprint) -> tuple[FootStep, FootStep]:
    """Return both steps of a stride: the other foot's, and the one that ends it."""
    displacement = last.ground_m - first.ground_m
    length_m = float(np.linalg.norm(displacement))
    halfway_m = float((other.ground_m - first.ground_m) @ displacement) / length_m
    stride = Stride(
        length_m, last.landed_s - first.landed_s, step_time_s=last.landed_s - other.landed_s
    )
    foot, counterpart = FEET if first.side + last.side >= other.side else FEET[::-1]
    return (
        FootStep(counterpart, other.landed_s, halfway_m, None),
        FootStep(foot, last.landed_s, length_m - halfway_m, stride),
    )


class StepMeter:
    """Computes the gait measures of one person over the last seconds; `up` as in `find_steps`."""

    def __init__(self, config: StepConfig, up: F64) -> None:
        self._config, self._up = config, up
        self._samples: dict[Side, deque[tuple[float, F64]]] = {foot: deque() for foot in FEET}
        self._due_s = -math.inf
        self._measures = GaitMeasures()

    def update(self, stamp_s: float, left_m: F64 | None, right_m: F64 | None) -> GaitMeasures:
        """Add the measured feet (3, fixed frame) of a frame and return the measures.

        Older frames than the last one are ignored.
        """
        for samples, point_m in zip(self._samples.values(), (left_m, right_m), strict=True):
            if point_m is not None and (not samples or samples[-1][0] < stamp_s):
                samples.append((stamp_s, point_m))
            while samples and samples[0][0] < stamp_s - self._config.window_s:
                samples.popleft()
        if stamp_s >= self._due_s:
            self._due_s = stamp_s + self._config.every_s
            self._measures = gait_measures(self.steps(), self._config)
        return self._measures

    def steps(self) -> list[FootStep]:
        """Return the steps of the last seconds."""
        left, right = (_trajectory(samples) for samples in self._samples.values())
        return find_steps(left, right, self._up, self._config)


def _trajectory(samples: Iterable[tuple[float, F64]]) -> FootTrajectory:
    rows = np.array([(time_s, *point_m) for time_s, point_m in samples]).reshape(-1, 4)
    return FootTrajectory(rows[:, 0], rows[:, 1:])
