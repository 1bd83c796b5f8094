"""Steps out of the paths of two feet.

While somebody walks, one foot stands whenever the other one moves. So the places at which some foot
was for a while are footprints, and it does not matter which foot each sample is said to be of: who
follows feet by what is seen of them takes one for the other now and then. Three footprints in a row
are a stride if the one between, of the other foot, lies halfway; where one was missed it does not.
Measures are made of strides: both ends are of one foot and seen alike, while of one foot the toes
may be seen and the heel of the other.
"""

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from people4d.messages import F64, GaitMeasures
from services.gait.steps.config import StepConfig

AT, ABOUT = 2.0, 2.5  # times the noise: where a foot stands, and where no other is looked for
COME = 0.75  # times the noise, before its place, where a foot has come down
STILL = 0.45  # of the samples of one foot about a time, from which on it stands
SHARED = 0.65  # of the time of a footprint, which another one may share
HALFWAY = (0.38, 0.62)  # of a stride; where a footprint was missed, the next is at two thirds
IN_TIME = (0.3, 0.7)  # the same of its time: who limps is late
IN_AIR = 0.25  # of a step: so long neither foot seems to stand
SIDES_MIN = 2  # steps of each foot, from which on they are compared

Indices: TypeAlias = npt.NDArray[np.intp]
Side = Literal["left", "right"]
FEET: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True)
class Stride:
    """A foot that went from one place to its next, past the other foot.

    Args:
        length_m: From place to place.
        time_s: That it took.
        step_time_s: Since the other foot came down.
    """

    length_m: float
    time_s: float
    step_time_s: float


@dataclass(frozen=True)
class Step:
    """A foot that came down.

    Args:
        foot: Which.
        landed_s: When.
        length_m: Along the way, from where the other foot stands.
        stride: That ended so; None where it was not seen.
    """

    foot: Side
    landed_s: float
    length_m: float
    stride: Stride | None


@dataclass(frozen=True)
class Path:
    """Where one foot was seen.

    Args:
        times_s: N, rising.
        points_m: Nx3, in a frame that stands still.
    """

    times_s: F64
    points_m: F64


@dataclass(frozen=True)
class _Samples:
    """What was seen of both feet; arrays are N long, in the order of time.

    Args:
        times_s: When.
        places_m: Nx2, on the ground.
        sides: 1: said to be the left foot, -1: the right one.
    """

    times_s: F64
    places_m: F64
    sides: F64


@dataclass(frozen=True)
class _Print:
    """Where a foot stood.

    Args:
        place_m: 2, on the ground.
        landed_s: When it came down.
        lifted_s: When it left.
        samples: What was seen there.
    """

    place_m: F64
    landed_s: float
    lifted_s: float
    samples: _Samples

    @property
    def side(self) -> float:
        """Above 0: more samples are said to be of the left foot than of the right one."""
        return float(self.samples.sides.sum())


def find_steps(left: Path, right: Path, up: F64, config: StepConfig) -> list[Step]:
    """Return the steps of a person in the order of time; none of who stands.

    Args:
        left: Of the left foot; samples that were guessed are better left out.
        right: Of the right foot.
        up: 3, unit, away from the ground.
        config: What counts as a step.
    """
    prints = _prints(_samples((left, right), up), config)
    steps: dict[int, Step] = {}
    for k, (first, other, last) in enumerate(zip(prints, prints[1:], prints[2:], strict=False)):
        if _is_stride(first, other, last, config):
            before, step = _steps(first, other, last)
            steps.setdefault(k, before)  # unless it is known as the end of a stride
            steps[k + 1] = step
    return list(steps.values())


def measures_of(steps: Sequence[Step], config: StepConfig) -> GaitMeasures:
    """Return what steps tell of a walk; nothing if they are few.

    Args:
        steps: Of one person, in the order of time.
        config: How many are needed.
    """
    even = even_strides(steps, config)
    if len(even) < config.strides_min:
        return GaitMeasures()
    length_m, time_s = (
        float(np.mean([getattr(stride, name) for _, stride in even]))
        for name in ("length_m", "time_s")
    )
    uneven = None
    left, right = ([one.step_time_s for step, one in even if step.foot == foot] for foot in FEET)
    if min(len(left), len(right)) >= SIDES_MIN:
        uneven = float(np.mean(left) - np.mean(right)) / (time_s / 2)
    return GaitMeasures(
        steps=len(even),
        step_length_m=length_m / 2,
        stride_length_m=length_m,
        cadence_per_min=2 * 60 / time_s,
        walking_speed_mps=length_m / time_s,
        step_time_asymmetry=uneven,
    )


def even_strides(steps: Sequence[Step], config: StepConfig) -> list[tuple[Step, Stride]]:
    """Return the strides that are like most others: no start, no stop, no turn.

    Args:
        steps: Of one person.
        config: How much strides differ in an even walk.
    """
    known = [(step, step.stride) for step in steps if step.stride]
    if not known:
        return []
    sizes = np.array([(stride.length_m, stride.time_s) for _, stride in known])
    off = np.abs(sizes / np.median(sizes, axis=0) - 1)
    even = (off <= (config.length_spread, config.time_spread)).all(axis=1)
    return [one for one, is_even in zip(known, even, strict=True) if is_even]


def _samples(feet: Sequence[Path], up: F64) -> _Samples:
    times_s = np.concatenate([foot.times_s for foot in feet])
    order = np.argsort(times_s, kind="stable")
    places_m = np.concatenate([foot.points_m for foot in feet]).reshape(-1, 3) @ _ground(up).T
    sides = np.repeat([1.0, -1.0], [len(foot.times_s) for foot in feet])
    return _Samples(times_s[order], places_m[order], sides[order])


def _prints(samples: _Samples, config: StepConfig) -> list[_Print]:
    """Return where feet stood, in the order of time; of those at one time the surest."""
    still = _stillness(samples, config)
    found: list[_Print] = []
    while still.max(initial=0.0) >= STILL:
        best = int(np.argmax(still))
        near = _stay(samples, best, samples.places_m[best], config)
        near = _stay(samples, best, np.median(samples.places_m[near], axis=0), config)
        still[best] = 0.0
        if len(near):
            one = _print(samples, near)
            span = slice(near[0], near[-1] + 1)
            off_m = np.linalg.norm(samples.places_m[span] - one.place_m, axis=1)
            still[span][off_m <= ABOUT * config.noise_m] = 0.0
            if _is_whole(samples, near, config):
                found.append(one)
    kept: list[_Print] = []
    for one in sorted(found, key=lambda each: -len(each.samples.times_s)):
        if all(_shared(one, other) <= SHARED for other in kept):
            kept.append(one)
    return _timed(sorted(kept, key=lambda each: each.landed_s + each.lifted_s), config)


def _stillness(samples: _Samples, config: StepConfig) -> F64:
    """Return for each sample how many of one foot's samples about its time are near it.

    Returns:
        N: 1 of a foot that stands, 2 of feet that stand together, little of one that swings.
    """
    near, all_ = np.ones(len(samples.times_s)), np.ones(len(samples.times_s))
    for k in range(1, len(near)):
        soon = samples.times_s[k:] - samples.times_s[:-k] <= config.still_s
        if not soon.any():
            break
        off_m = np.linalg.norm(samples.places_m[k:] - samples.places_m[:-k], axis=1)
        alike = soon * np.exp(-((off_m / (2 * config.noise_m)) ** 2))
        for part in (slice(k, None), slice(None, -k)):
            near[part] += alike
            all_[part] += soon
    return np.asarray(near / np.maximum(all_ / 2, 1.0))  # of two feet


def _stay(samples: _Samples, at: int, place_m: F64, config: StepConfig) -> Indices:
    """Return the samples at a place without a break, before and after one of them."""
    time_s = samples.times_s[at]
    reach_s = 2 * config.step_max_s
    begin, end = np.searchsorted(samples.times_s, (time_s - reach_s, time_s + reach_s))
    off_m = np.linalg.norm(samples.places_m[begin:end] - place_m, axis=1)
    near: Indices = begin + np.flatnonzero(off_m <= AT * config.noise_m)
    for part in np.split(near, np.flatnonzero(np.diff(samples.times_s[near]) > config.gap_s) + 1):
        if len(part) and samples.times_s[part[0]] <= time_s <= samples.times_s[part[-1]]:
            return np.asarray(part)
    return near[:0]


def _print(samples: _Samples, near: Indices) -> _Print:
    seen = _Samples(samples.times_s[near], samples.places_m[near], samples.sides[near])
    begin_s, end_s = seen.times_s[[0, -1]].tolist()
    return _Print(np.median(seen.places_m, axis=0), begin_s, end_s, seen)


def _is_whole(samples: _Samples, near: Indices, config: StepConfig) -> bool:
    """Tell whether a foot stood for long enough and was seen coming, or could have been."""
    times_s, first = samples.times_s, near[0]
    if not first or times_s[first] - times_s[first - 1] > config.gap_s:
        return False
    return bool(
        times_s[first] > times_s[0] and times_s[near[-1]] - times_s[first] >= config.stance_min_s
    )


def _timed(prints: Sequence[_Print], config: StepConfig) -> list[_Print]:
    """Return footprints with the times at which feet came there, by the way between the others.

    How long a foot is near its place before that depends on how fast it swings.
    """
    timed = []
    for k, one in enumerate(prints):
        way = prints[min(k + 1, len(prints) - 1)].place_m - prints[max(k - 1, 0)].place_m
        way = way / max(float(np.linalg.norm(way)), 1e-9)
        to_go_m = (one.place_m - one.samples.places_m) @ way - COME * config.noise_m
        n = int(np.argmax(to_go_m <= 0.0))
        if n:
            share = to_go_m[n - 1] / (to_go_m[n - 1] - to_go_m[n])
            begin_s, end_s = one.samples.times_s[[n - 1, n]].tolist()
            one = replace(one, landed_s=float(begin_s + share * (end_s - begin_s)))
        timed.append(one)
    return timed


def _shared(one: _Print, other: _Print) -> float:
    """Return for which part of the shorter one's time both are there."""
    both_s = min(one.lifted_s, other.lifted_s) - max(one.landed_s, other.landed_s)
    return both_s / min(one.lifted_s - one.landed_s, other.lifted_s - other.landed_s)


def _is_stride(first: _Print, other: _Print, last: _Print, config: StepConfig) -> bool:
    """Tell whether a foot went from one print to another, past the other foot."""
    way = last.place_m - first.place_m
    length_m, time_s = float(np.linalg.norm(way)), last.landed_s - first.landed_s
    if not 2 * config.step_min_s <= time_s <= 2 * config.step_max_s:
        return False
    if length_m < max(2 * config.length_min_m, config.speed_min_mps * time_s):
        return False
    halfway = float((other.place_m - first.place_m) @ way) / length_m**2
    in_time = (other.landed_s - first.landed_s) / time_s
    in_air_s = max(other.landed_s - first.lifted_s, last.landed_s - other.lifted_s)
    return (
        HALFWAY[0] <= halfway <= HALFWAY[1]
        and IN_TIME[0] <= in_time <= IN_TIME[1]
        and in_air_s <= IN_AIR * time_s / 2
    )


def _steps(first: _Print, other: _Print, last: _Print) -> tuple[Step, Step]:
    """Return both steps of a stride: the other foot's, and that which ends it."""
    way = last.place_m - first.place_m
    length_m = float(np.linalg.norm(way))
    halfway_m = float((other.place_m - first.place_m) @ way) / length_m
    stride = Stride(
        length_m, last.landed_s - first.landed_s, step_time_s=last.landed_s - other.landed_s
    )
    foot, beside = FEET if first.side + last.side >= other.side else FEET[::-1]
    return (
        Step(beside, other.landed_s, halfway_m, None),
        Step(foot, last.landed_s, length_m - halfway_m, stride),
    )


def _ground(up: F64) -> F64:
    """Return two directions of the ground, 2x3, at right angles to each other."""
    least = np.eye(3)[int(np.argmin(np.abs(up)))]
    first = np.cross(up, least)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)])


class StepMeter:
    """Follows the feet of one person and tells how they walked in the last seconds.

    Args:
        config: What counts as a step.
        up: 3, unit, away from the ground, in the frame of the feet.
    """

    def __init__(self, config: StepConfig, up: F64) -> None:
        self._config, self._up = config, up
        self._seen: dict[Side, deque[tuple[float, F64]]] = {foot: deque() for foot in FEET}
        self._due_s = -math.inf
        self._told = GaitMeasures()

    def update(self, stamp_s: float, left_m: F64 | None, right_m: F64 | None) -> GaitMeasures:
        """Take where the feet are in a frame.

        Args:
            stamp_s: Time of the frame; one that is not after the last is passed over.
            left_m: 3, in a frame that stands still; None where the foot was not seen.
            right_m: Likewise.
        """
        for seen, point_m in zip(self._seen.values(), (left_m, right_m), strict=True):
            if point_m is not None and (not seen or seen[-1][0] < stamp_s):
                seen.append((stamp_s, point_m))
            while seen and seen[0][0] < stamp_s - self._config.window_s:
                seen.popleft()
        if stamp_s >= self._due_s:
            self._due_s = stamp_s + self._config.every_s
            self._told = measures_of(self.steps(), self._config)
        return self._told

    def steps(self) -> list[Step]:
        """Return the steps of the last seconds."""
        left, right = (_path(seen) for seen in self._seen.values())
        return find_steps(left, right, self._up, self._config)


def _path(seen: Iterable[tuple[float, F64]]) -> Path:
    rows = np.array([(time_s, *point_m) for time_s, point_m in seen]).reshape(-1, 4)
    return Path(rows[:, 0], rows[:, 1:])
