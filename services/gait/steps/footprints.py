"""Footprints: positions where feet stood, by the trajectories of both feet.

While a person walks, one foot stands whenever the other one moves. A position where some foot stays
is a footprint, whichever foot the samples are assigned to: the point filters confuse feet at times.

Source: docs/method.md, section 20.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from people4d.messages import F64
from services.gait.config import StepConfig

# Times the noise: samples of a standing foot; samples that belong to no other footprint
SAME_SIGMAS, OCCUPIED_SIGMAS = 2.0, 2.5
LANDED_SIGMAS = 0.75  # times the noise, before the footprint, where a foot has come down
STILLNESS_MIN = 0.45  # of a sample of a standing foot
SHARED_MAX = 0.65  # of the time of a footprint, in which there may be another one

Indices: TypeAlias = npt.NDArray[np.intp]


@dataclass(frozen=True)
class FootTrajectory:
    """Measured positions of one foot."""

    times_s: F64  # N, rising
    points_m: F64  # Nx3, in a fixed frame


@dataclass(frozen=True)
class _Samples:
    times_s: F64  # N
    ground_m: F64  # Nx2, on the ground
    sides: F64  # N, 1: assigned to the left foot, -1: to the right one


@dataclass(frozen=True)
class Footprint:
    """Position where a foot stood."""

    ground_m: F64  # 2, on the ground
    landed_s: float
    lifted_s: float
    samples: _Samples  # of the foot there

    @property
    def side(self) -> float:
        """Above 0 if more samples are assigned to the left foot than to the right one."""
        return float(self.samples.sides.sum())


def find_footprints(
    left: FootTrajectory, right: FootTrajectory, up: F64, config: StepConfig
) -> list[Footprint]:
    """Return footprints in the order of time; of those at one time the one of most samples."""
    samples = _merged((left, right), up)
    still = _stillness(samples, config)
    found: list[Footprint] = []
    while still.max(initial=0.0) >= STILLNESS_MIN:
        best = int(np.argmax(still))
        near = _stance(samples, best, samples.ground_m[best], config)
        near = _stance(samples, best, np.median(samples.ground_m[near], axis=0), config)
        still[best] = 0.0
        if len(near):
            one = _footprint(samples, near)
            span = slice(near[0], near[-1] + 1)
            off_m = np.linalg.norm(samples.ground_m[span] - one.ground_m, axis=1)
            still[span][off_m <= OCCUPIED_SIGMAS * config.noise_m] = 0.0
            if _is_complete(samples, near, config):
                found.append(one)
    distinct: list[Footprint] = []
    for one in sorted(found, key=lambda each: -len(each.samples.times_s)):
        if all(_shared(one, other) <= SHARED_MAX for other in distinct):
            distinct.append(one)
    return _landed(sorted(distinct, key=lambda each: each.landed_s + each.lifted_s), config)


def _merged(feet: Sequence[FootTrajectory], up: F64) -> _Samples:
    times_s = np.concatenate([foot.times_s for foot in feet])
    order = np.argsort(times_s, kind="stable")
    ground_m = np.concatenate([foot.points_m for foot in feet]).reshape(-1, 3) @ _ground(up).T
    sides = np.repeat([1.0, -1.0], [len(foot.times_s) for foot in feet])
    return _Samples(times_s[order], ground_m[order], sides[order])


def _ground(up: F64) -> F64:
    """Return two orthogonal directions of the ground, 2x3."""
    least = np.eye(3)[int(np.argmin(np.abs(up)))]
    first = np.cross(up, least)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)])


def _stillness(samples: _Samples, config: StepConfig) -> F64:
    """Return the ratio of one foot's samples about the time of each sample that are near it.

    Returns:
        N: 1 of a standing foot, 2 of feet that stand together, near 0 of a swinging one.
    """
    near, all_ = np.ones(len(samples.times_s)), np.ones(len(samples.times_s))
    for k in range(1, len(near)):
        soon = samples.times_s[k:] - samples.times_s[:-k] <= config.still_s
        if not soon.any():
            break
        off_m = np.linalg.norm(samples.ground_m[k:] - samples.ground_m[:-k], axis=1)
        same = soon * np.exp(-((off_m / (2 * config.noise_m)) ** 2))
        for part in (slice(k, None), slice(None, -k)):
            near[part] += same
            all_[part] += soon
    return np.asarray(near / np.maximum(all_ / 2, 1.0))  # of two feet


def _stance(samples: _Samples, at: int, ground_m: F64, config: StepConfig) -> Indices:
    """Return the samples near a position, contiguous in time with sample `at`."""
    time_s = samples.times_s[at]
    reach_s = 2 * config.step_max_s
    begin, end = np.searchsorted(samples.times_s, (time_s - reach_s, time_s + reach_s))
    off_m = np.linalg.norm(samples.ground_m[begin:end] - ground_m, axis=1)
    near: Indices = begin + np.flatnonzero(off_m <= SAME_SIGMAS * config.noise_m)
    for part in np.split(near, np.flatnonzero(np.diff(samples.times_s[near]) > config.gap_s) + 1):
        if len(part) and samples.times_s[part[0]] <= time_s <= samples.times_s[part[-1]]:
            return np.asarray(part)
    return near[:0]


def _footprint(samples: _Samples, near: Indices) -> Footprint:
    own = _Samples(samples.times_s[near], samples.ground_m[near], samples.sides[near])
    begin_s, end_s = own.times_s[[0, -1]].tolist()
    return Footprint(np.median(own.ground_m, axis=0), begin_s, end_s, own)


def _is_complete(samples: _Samples, near: Indices, config: StepConfig) -> bool:
    """Check that a foot stood for long enough, with samples shortly before it landed."""
    times_s, first = samples.times_s, near[0]
    if not first or times_s[first] - times_s[first - 1] > config.gap_s:
        return False
    return bool(
        times_s[first] > times_s[0] and times_s[near[-1]] - times_s[first] >= config.stance_min_s
    )


def _shared(one: Footprint, other: Footprint) -> float:
    """Return the overlap in time of two footprints, as a ratio of the shorter one."""
    both_s = min(one.lifted_s, other.lifted_s) - max(one.landed_s, other.landed_s)
    return both_s / min(one.lifted_s - one.landed_s, other.lifted_s - other.landed_s)


def _landed(footprints: Sequence[Footprint], config: StepConfig) -> list[Footprint]:
    """Return footprints with times of landing, by the displacement between their neighbours.

    The time that a foot is near its footprint before landing depends on the speed of its swing.
    """
    timed = []
    for k, one in enumerate(footprints):
        after, before = footprints[min(k + 1, len(footprints) - 1)], footprints[max(k - 1, 0)]
        direction = after.ground_m - before.ground_m
        direction = direction / max(float(np.linalg.norm(direction)), 1e-9)
        to_go_m = (one.ground_m - one.samples.ground_m) @ direction - LANDED_SIGMAS * config.noise_m
        n = int(np.argmax(to_go_m <= 0.0))
        if n:
            ratio = to_go_m[n - 1] / (to_go_m[n - 1] - to_go_m[n])
            begin_s, end_s = one.samples.times_s[[n - 1, n]].tolist()
            one = replace(one, landed_s=float(begin_s + ratio * (end_s - begin_s)))
        timed.append(one)
    return timed
