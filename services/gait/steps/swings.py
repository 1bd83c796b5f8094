"""Swings: motions of a foot from one footprint to its next.

Each foot is evaluated by itself. A foot hidden in its swing lands between the landing and the lift
of the other foot.

Source: docs/method.md, section 20.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from people4d.messages import F64
from services.gait.steps.stances import (
    LENGTH_MIN_M,
    Bins,
    Stance,
    collect_bins,
    find_inliers,
    find_stances,
)

BIN_S = 0.05  # Minimum length of a bin [s]
NOISE_M = 0.06  # Noise of a standing foot, in addition to the noise of its point [m]
GAP_S = 0.5  # Maximum hidden time of a foot in a swing [s]
# Ratios of the length of a swing: lift of the foot, and range of its approach to the footprint
LIFTED, APPROACH = 0.1, (0.7, 0.92)
SWING_MAX_S = 1.2  # Maximum time of a visible swing [s]
ALONE_MIN = 0.4  # Minimum share of a swing without a swing of the other foot
LANDED_S = 0.2  # Minimum time after a confirmed landing [s]
# Minimum gap between samples with an unknown share of standing [s, frames]
HIDDEN_S, HIDDEN_FRAMES = 0.15, 1.5
BRIEF_S = 0.25  # Time of a swing of full confidence before or after a long stance [s]
STANDING_S = 1.2  # Minimum time of a long stance, of a standing person [s]
CLEAR = 1.5  # Length of a swing of full confidence [LENGTH_MIN_M]

Side = Literal["left", "right"]
FEET: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True)
class FootTrajectory:
    """Positions of one foot, measured or predicted."""

    times_s: F64  # N, rising
    points_m: F64  # Nx3, in a fixed frame
    covariances_m2: F64  # Nx3x3, of the points


@dataclass(frozen=True)
class Swing:
    """Motion of a foot from one footprint to its next."""

    foot: Side
    lifted_s: float
    landed_s: float
    from_m: F64  # 2, footprint on the ground
    to_m: F64  # 2
    other_m: F64  # 2, position of the other foot at this landing; NaN if not visible
    confidence: float  # 0 to 1

    @property
    def length_m(self) -> float:
        """Distance between both footprints: a stride in walking, a step at a start or stop."""
        return float(np.linalg.norm(self.to_m - self.from_m))


def find_swings(left: FootTrajectory, right: FootTrajectory, up: F64) -> list[Swing]:
    """Return the swings of both feet in the order of their landings."""
    feet = _binned((left, right), up)
    if feet is None:
        return []
    stances = [find_stances(bins) for bins in feet]
    found = [one for side in range(2) for one in _swings(feet, stances, side)]
    return sorted(found, key=lambda one: one.landed_s)


def _binned(feet: tuple[FootTrajectory, FootTrajectory], up: F64) -> tuple[Bins, Bins] | None:
    """Return both paths on the ground in the same bins; None with too few samples."""
    if min(len(foot.times_s) for foot in feet) < 2:
        return None
    end_s = max(float(foot.times_s[-1]) for foot in feet)
    spacing_s = float(np.median(np.concatenate([np.diff(foot.times_s) for foot in feet])))
    bin_s = max(BIN_S, spacing_s)
    # Frames are in the middle of their bins, which tolerates small jitter.
    origin_s = min(float(foot.times_s[0]) for foot in feet) - bin_s / 2
    count = int((end_s - origin_s) / bin_s) + 1
    if count < 3:
        return None
    axes = _ground(up)
    both = []
    for foot in feet:
        ground = foot.points_m @ axes.T
        noise = NOISE_M**2 * np.eye(2) + axes @ foot.covariances_m2 @ axes.T
        known = find_inliers(ground, noise)
        both.append(
            collect_bins(foot.times_s[known], ground[known], noise[known], origin_s, count, bin_s)
        )
    if not all(bins.sampled.any() for bins in both):
        return None
    return both[0], both[1]


def _ground(up: F64) -> F64:
    """Return two orthogonal directions of the ground, 2x3."""
    least = np.eye(3)[int(np.argmin(np.abs(up)))]
    first = np.cross(up, least)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)])


def _swings(feet: tuple[Bins, Bins], stances: Sequence[Sequence[Stance]], side: int) -> list[Swing]:
    """Return the swings of one foot between its stances."""
    bins, own = feet[side], list(stances[side])
    if own and own[0].begin:
        first = int(np.flatnonzero(bins.sampled)[0])
        if first < own[0].begin:  # the path begins with a swing
            own.insert(0, Stance(first, first + 1, bins.position_m(first, first + 1)))
    found = []
    for before, after in pairwise(own):
        swing = _swing(feet, stances[1 - side], side, before, after)
        if swing is not None:
            found.append(swing)
    return found


def _swing(
    feet: tuple[Bins, Bins],
    others: Sequence[Stance],
    side: int,
    before: Stance,
    after: Stance,
) -> Swing | None:
    """Return the swing between two stances; None if it is no step."""
    bins, from_m, to_m = feet[side], before.position_m, after.position_m
    times_s, length_m = bins.times_s, float(np.linalg.norm(to_m - from_m))
    first, last = before.end - 1, after.begin
    time_s = float(times_s[last] - times_s[first])
    if length_m < LENGTH_MIN_M or time_s > GAP_S + SWING_MAX_S:
        return None
    end_s = float(times_s[max(np.flatnonzero(one.sampled)[-1] for one in feet)])
    if end_s - times_s[last] < LANDED_S:  # the foot may still move
        return None
    known = [k for k in range(first, last + 1) if bins.sampled[k]]
    along = np.array([bins.position_m(k, k + 1) for k in known]) - from_m
    along = np.maximum.accumulate(along @ (to_m - from_m) / length_m**2)
    hidden_s = max(HIDDEN_S, HIDDEN_FRAMES * float(times_s[1] - times_s[0]))
    lifted_s = _crossing_s(times_s[known], along, LIFTED, hidden_s)
    landed_s = min(_landed_s(times_s[known], along, hidden_s), float(times_s[last]) + BIN_S)
    moving = slice(first + 1, last)
    stands = np.zeros(len(times_s), bool)
    for one in others:
        stands[one.begin : one.end] = True
    alone = float(np.mean((stands | ~feet[1 - side].sampled)[moving])) if last - first > 1 else 1.0
    if alone < ALONE_MIN:
        return None
    there = [one for one in others if times_s[one.begin] <= landed_s <= times_s[one.end - 1] + 0.1]
    visible = float(bins.sampled[max(first - 2, 0) : last + 3].mean())
    clear = min(1.0, length_m / (CLEAR * LENGTH_MIN_M))
    stood_s = max(float(times_s[one.end - 1] - times_s[one.begin]) for one in (before, after))
    swift = min(1.0, time_s / BRIEF_S) if stood_s > STANDING_S else 1.0
    return Swing(
        foot=FEET[side],
        lifted_s=lifted_s,
        landed_s=landed_s,
        from_m=from_m,
        to_m=to_m,
        other_m=there[-1].position_m if there else np.full(2, np.nan),
        confidence=clear * visible * alone * swift,
    )


def _landed_s(times_s: F64, along: F64, hidden_s: float) -> float:
    """Return the time at which a foot reaches its footprint at its speed of approach.

    The end of the path itself is uncertain, since its speed is as small as its noise.
    """
    far_s, near_s = (_crossing_s(times_s, along, edge, hidden_s) for edge in APPROACH)
    return near_s + (1.0 - APPROACH[1]) / (APPROACH[1] - APPROACH[0]) * max(near_s - far_s, 0.0)


def _crossing_s(times_s: F64, along: F64, edge: float, hidden_s: float) -> float:
    """Return the time at which a rising path crosses a level; middle of a gap over `hidden_s`."""
    k = int(np.searchsorted(along, edge))
    if k == 0 or k == len(along):
        return float(times_s[min(k, len(along) - 1)])
    ratio = (edge - along[k - 1]) / max(along[k] - along[k - 1], 1e-9)
    gap_s = float(times_s[k] - times_s[k - 1])
    ratio = 0.5 if gap_s > hidden_s else ratio
    return float(times_s[k - 1]) + ratio * gap_s
