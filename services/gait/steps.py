"""Steps out of the paths of two feet.

While one foot stands, the other swings past it: the separation of the feet along the way changes
its sign. There the standing foot lies flat, and the swing is fastest, so that both its place and
that moment are told best. Between two passes the feet are farthest apart: the heel came down.
"""

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter
from scipy.signal import savgol_filter

from common.messages import F64, GaitMeasures
from services.gait.steps_config import StepConfig

GRID_S = 0.02
SPIKE, SPIKE_M = 3, 0.2  # samples of a median, and how far off it a single one is wrong
HYSTERESIS = 0.35  # of the separation at heel contact: less is no change of the foot in front

LANDING = 0.75  # of the way ahead, which a swinging foot goes evenly
PAUSE = 1.6  # of the usual time of a step, from which on somebody paused

Side = Literal["left", "right"]
FEET: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True)
class Step:
    """One foot, from where the other stands to where this one comes down.

    Args:
        foot: The foot that moved.
        landed_s: When the foot came down.
        passed_s: When the foot passed the other one.
        ended_s: When the other foot passed it.
        length_m: Along the way, from the other foot to this one.
        stride_m: Of this foot, from its stance before; None where that is not known.
    """

    foot: Side
    landed_s: float
    passed_s: float
    ended_s: float
    length_m: float
    stride_m: float | None


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
class _Pass:
    """A foot that swings past the other one.

    Args:
        time_s: When.
        side: 1: the left foot passes, -1: the right one.
        stance_m: 2, where the other foot stands.
        heading: 2, unit, the way of walking.
    """

    time_s: float
    side: int
    stance_m: F64
    heading: F64


@dataclass(frozen=True)
class _Walk:
    """A stretch of time in which both feet are known; arrays are T long.

    Args:
        times_s: In steps of GRID_S.
        feet_m: 2xTx2, left and right on the ground.
        heading: Tx2, unit, the way of walking.
        moving: Whether the person walks.
        ahead_m: How far the left foot is ahead of the right one.
    """

    times_s: F64
    feet_m: F64
    heading: F64
    moving: np.ndarray
    ahead_m: F64


def find_steps(left: Path, right: Path, up: F64, config: StepConfig) -> list[Step]:
    """Return the steps of a person in the order of time; none of who stands.

    Args:
        left: Of the left foot; samples that were guessed are better left out.
        right: Of the right foot.
        up: 3, unit, away from the ground.
        config: What counts as a step.
    """
    steps: list[Step] = []
    for walk in _walks(left, right, up, config):
        for chain in _chains(_passes(walk, config), config):
            steps += _steps(walk, chain)
    return steps


def measures_of(steps: Sequence[Step], config: StepConfig) -> GaitMeasures:
    """Return what steps tell of a walk; nothing if they are few.

    Args:
        steps: Of one person, in the order of time.
        config: How many are needed.
    """
    timed = _timed(steps)
    if len(steps) < config.steps_min or not timed:
        return GaitMeasures()
    times_s = [time_s for _, time_s in timed]
    limit_s = PAUSE * float(np.median(times_s))
    timed = [(foot, time_s) for foot, time_s in timed if time_s <= limit_s]
    step_s = float(np.mean([time_s for _, time_s in timed]))
    strides = [step.stride_m for step in steps if step.stride_m is not None]
    # What is seen of a foot may lie ahead of what is seen of the other, which makes one side's
    # steps longer and the other's shorter: their mean is right.
    sides = [[step.length_m for step in steps if step.foot == foot] for foot in FEET]
    length_m = float(np.mean([np.mean(side) for side in sides if side]))
    uneven = None
    left, right = ([time_s for side, time_s in timed if side == foot] for foot in FEET)
    if min(len(left), len(right)) >= 2:
        uneven = float((np.mean(left) - np.mean(right)) / step_s)
    return GaitMeasures(
        steps=len(steps),
        step_length_m=length_m,
        stride_length_m=float(np.mean(strides)) if strides else None,
        cadence_per_min=60.0 / step_s,
        walking_speed_mps=length_m / step_s,
        step_time_asymmetry=uneven,
    )


def _timed(steps: Sequence[Step]) -> list[tuple[Side, float]]:
    """Return the foot and the time of steps that follow one: from its coming down to theirs."""
    return [
        (step.foot, step.landed_s - before.landed_s)
        for before, step in pairwise(steps)
        if step.passed_s == before.ended_s
    ]


def _walks(left: Path, right: Path, up: F64, config: StepConfig) -> Iterator[_Walk]:
    """Yield the stretches in which both feet are known well enough."""
    if min(len(left.times_s), len(right.times_s)) < 2 * SPIKE:
        return
    begin = max(left.times_s[0], right.times_s[0])
    end = min(left.times_s[-1], right.times_s[-1])
    times_s = np.arange(begin, end, GRID_S)
    known = _near(left.times_s, times_s, config.gap_s) & _near(right.times_s, times_s, config.gap_s)
    ground = _ground(up)
    feet_m = np.stack([_resampled(path, times_s) @ ground.T for path in (left, right)])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(np.int8)))
    for first, last in edges.reshape(-1, 2):
        if (last - first) * GRID_S >= 2 * config.step_min_s:
            yield _walk(times_s[first:last], feet_m[:, first:last], config)


def _walk(times_s: F64, feet_m: F64, config: StepConfig) -> _Walk:
    length = min(round(config.heading_s / GRID_S), len(times_s)) // 2 * 2 - 1
    velocity = savgol_filter(feet_m.mean(axis=0), length, 1, deriv=1, delta=GRID_S, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    heading = velocity / np.maximum(speed, 1e-9)[:, None]
    ahead_m = np.einsum("tk,tk->t", feet_m[0] - feet_m[1], heading)
    ahead_m = gaussian_filter1d(ahead_m, config.smooth_s / GRID_S, mode="nearest")
    return _Walk(times_s, feet_m, heading, speed >= config.speed_min_mps, ahead_m)


def _passes(walk: _Walk, config: StepConfig) -> list[_Pass]:
    """Return the moments at which one foot passes the other."""
    usual_m = float(np.percentile(np.abs(walk.ahead_m[walk.moving]), 80)) if any(walk.moving) else 0
    threshold_m = max(HYSTERESIS * usual_m, config.separation_min_m / 2)
    clear = np.flatnonzero((np.abs(walk.ahead_m) > threshold_m) & walk.moving)
    signs = np.sign(walk.ahead_m[clear]).astype(int)
    half = round(config.stance_s / 2 / GRID_S)
    passes = []
    for k in np.flatnonzero(np.diff(signs)):
        begin, end, side = int(clear[k]), int(clear[k + 1]), int(signs[k + 1])
        if not walk.moving[begin : end + 1].all():
            continue
        part = slice(begin, end + 1)
        slope, start = np.polyfit(walk.times_s[part] - walk.times_s[begin], walk.ahead_m[part], 1)
        if slope * side <= 0:
            continue
        time_s = float(walk.times_s[begin] - start / slope)
        middle = int(np.clip(round((time_s - walk.times_s[0]) / GRID_S), begin, end))
        still = walk.feet_m[int(side > 0), max(middle - half, 0) : middle + half + 1]
        passes.append(_Pass(time_s, side, np.median(still, axis=0), walk.heading[middle]))
    return passes


def _chains(passes: Sequence[_Pass], config: StepConfig) -> Iterator[list[_Pass]]:
    """Yield passes that follow one another as those of somebody walking do."""
    chain: list[_Pass] = []
    for one in passes:
        gap_s = one.time_s - chain[-1].time_s if chain else 0.0
        if chain and not (
            config.step_min_s <= gap_s <= config.step_max_s and one.side == -chain[-1].side
        ):
            yield chain
            chain = []
        chain.append(one)
    yield chain


def _steps(walk: _Walk, chain: Sequence[_Pass]) -> Iterator[Step]:
    """Yield the steps between passes: a foot passes the other, which then passes it."""
    for k, (passed, after) in enumerate(pairwise(chain)):
        heading = passed.heading + after.heading
        heading = heading / max(float(np.linalg.norm(heading)), 1e-9)
        # What stood while the other foot passed before is the foot that moves now.
        stride = after.stance_m - chain[k - 1].stance_m if k else None
        yield Step(
            foot="left" if passed.side > 0 else "right",
            landed_s=_landed_s(walk, passed, after),
            passed_s=passed.time_s,
            ended_s=after.time_s,
            length_m=float((after.stance_m - passed.stance_m) @ heading),
            stride_m=None if stride is None else float(np.linalg.norm(stride)),
        )


def _landed_s(walk: _Walk, passed: _Pass, after: _Pass) -> float:
    """Return when a foot that passed the other one came down.

    How far it is ahead changes little about that moment but much before: it would have been as far
    ahead as it came, had it gone on as evenly as it began.
    """
    within = (walk.times_s > passed.time_s) & (walk.times_s < after.time_s)
    ahead_m = walk.ahead_m[within] * passed.side
    most_m = float(ahead_m.max())
    k = int(np.argmax(ahead_m >= LANDING * most_m))
    times_s = walk.times_s[within]
    before_s, before_m = (times_s[k - 1], ahead_m[k - 1]) if k else (passed.time_s, 0.0)
    share = (LANDING * most_m - before_m) / (ahead_m[k] - before_m)
    reached_s = before_s + share * (times_s[k] - before_s)
    return float(passed.time_s + (reached_s - passed.time_s) / LANDING)


def _near(samples_s: F64, times_s: F64, gap_s: float) -> np.ndarray:
    """Tell which times lie between two samples that are not far from each other."""
    after = np.clip(np.searchsorted(samples_s, times_s), 1, len(samples_s) - 1)
    return np.asarray(samples_s[after] - samples_s[after - 1] <= gap_s)


def _resampled(path: Path, times_s: F64) -> F64:
    """Return a foot's places at other times, Tx3, without single samples that stick out."""
    usual = median_filter(path.points_m, (SPIKE, 1), mode="nearest")
    off_m = np.linalg.norm(path.points_m - usual, axis=1, keepdims=True)
    points = np.where(off_m > SPIKE_M, usual, path.points_m)
    return np.stack([np.interp(times_s, path.times_s, column) for column in points.T], axis=1)


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
