"""Alternation of feet: interpretation of landings as left, right and missing steps.

Feet take turns. Between two landings of one foot a stride apart, the other foot took an unseen
step. Of two landings of one foot a step apart, one has the wrong side. Dynamic programming finds
the best interpretation of all landings.

Source: docs/method.md, section 20.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import log

import numpy as np

from services.gait.steps.stances import LENGTH_MIN_M
from services.gait.steps.swings import FEET, Swing

# Costs of an exchanged foot, a false landing, an unseen step, and an unknown part of the walk
# [squared deviations]
FLIP, DROP, MISSED, UNKNOWN = 4.0, 7.0, 3.0, 9.0
STEP_MIN_S, STEP_MAX_S = 0.25, 1.5  # Range of the time of a step [s]
TIME_SIGMA = 0.3  # Standard deviation of the logarithm of the time of a step over the median
BACK = 4  # Maximum index difference of consecutive true landings, with false ones between them
BETWEEN_MIN_S = 0.2  # Minimum time between landings [s]
APART = 0.7  # Minimum time between an isolated landing and others [median steps]
UNSEEN_MIN_M = 0.3  # Minimum length of an unseen step [m]
# Maximum time of a single step; longer ones contain a stop or quick steps of a turn [median steps]
SINGLE_MAX = 1.6


@dataclass(frozen=True)
class Landing:
    """Landing of a foot in a walk."""

    swing: Swing
    side: int  # index into FEET
    steps: int  # number of steps since the last landing, including this one; 0 if unknown


def find_landings(swings: Sequence[Swing]) -> list[Landing]:
    """Return the landings of the most likely walk, in the order of time."""
    sides = [FEET.index(one.foot) for one in swings]
    period_s = _period_s(swings)
    if len(swings) < 3 or period_s is None:
        return [Landing(one, side, 0) for one, side in zip(swings, sides, strict=True)]
    dropped = np.cumsum([0.0, *(DROP * (0.4 + 0.6 * one.confidence) for one in swings)])
    # Cost of a walk that ends in a landing of a side, the landing before it, and steps since then.
    best: dict[tuple[int, int], tuple[float, tuple[int, int] | None, int]] = {}
    for j, swing in enumerate(swings):
        for side in (0, 1):
            own = FLIP * (0.5 + 0.5 * swing.confidence) * (side != sides[j])
            options: list[tuple[float, tuple[int, int] | None, int]] = [
                (float(dropped[j]) + own, None, 0)
            ]
            for i in range(max(0, j - BACK), j):
                time_s = swing.landed_s - swings[i].landed_s
                if time_s < BETWEEN_MIN_S:
                    continue
                for before in (0, 1):
                    same = before == side
                    stood = _stood(swings[i], swing, same)
                    cost, steps = _steps_between(time_s / period_s, same, stood)
                    cost += best[i, before][0] + float(dropped[j] - dropped[i + 1]) + own
                    options.append((cost, (i, before), steps))
            best[j, side] = min(options, key=lambda one: one[0])
    end = min(best, key=lambda key: best[key][0] + float(dropped[-1] - dropped[key[0] + 1]))
    found: list[Landing] = []
    at: tuple[int, int] | None = end
    while at is not None:
        _, before_at, steps = best[at]
        found.append(Landing(swings[at[0]], at[1], steps))
        at = before_at
    return _with_apart(found[::-1], swings, period_s)


def _with_apart(
    found: Sequence[Landing], swings: Sequence[Swing], period_s: float
) -> list[Landing]:
    """Return a walk completed with the isolated landings before, after and in its pauses."""
    known = list(found)
    for swing in swings:
        times_s = np.array([one.swing.landed_s for one in known])
        k = int(np.searchsorted(times_s, swing.landed_s))
        apart = np.abs(times_s - swing.landed_s).min() > APART * period_s
        if apart and (k in (0, len(known)) or not known[k].steps):
            known.insert(k, Landing(swing, FEET.index(swing.foot), 0))
    return known


def _steps_between(ratio: float, same: bool, stood: bool) -> tuple[float, int]:
    """Return cost and number of the steps between two landings, by time [median steps].

    A standing foot takes no unseen steps. Too long steps are unknown: the walk continues after
    them, but its rhythm does not.
    """
    counts = (2,) if same else (1, 3)
    costs = [
        ((log(ratio / steps) / TIME_SIGMA) ** 2 + (steps - 1) * MISSED, steps)
        for steps in counts
        if steps == 1 or not stood
    ]
    cost, steps = min([*costs, (UNKNOWN, 0)])
    return (cost, 0) if steps and ratio / steps > SINGLE_MAX else (cost, steps)


def _stood(before: Swing, after: Swing, same: bool) -> bool:
    """Check that the foot of an unseen step between two landings stood.

    It also counts as standing if the person hardly moved, as in a stop or a turn on the spot.
    """
    steps = 2 if same else 3
    if np.linalg.norm(after.to_m - before.to_m) < steps * UNSEEN_MIN_M:
        return True
    if same:
        moved_m = [after.other_m - before.other_m]
    else:
        moved_m = [after.from_m - before.other_m, after.other_m - before.to_m]
    return any(bool(np.linalg.norm(one) < LENGTH_MIN_M) for one in moved_m)


def _period_s(swings: Sequence[Swing]) -> float | None:
    """Return the median time of steps, by both feet and by each alone."""
    landed = [(one.foot, one.landed_s) for one in swings]
    times = [b - a for (one, a), (other, b) in pairwise(landed) if one != other]
    for foot in FEET:
        times += (np.diff([time_s for one, time_s in landed if one == foot]) / 2).tolist()
    known = [time_s for time_s in times if STEP_MIN_S < time_s < STEP_MAX_S]
    return float(np.median(known)) if known else None
