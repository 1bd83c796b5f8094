"""Step length and cadence from the feet that are told, against the steps truly made."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.gait_points import Followed, in_map
from benchmarks.gait_takes import POINTS, Take
from benchmarks.table import markdown
from common.messages import F64
from services.camera.lab.marks import Footfall
from services.gait.steps import FEET, Step, StepMeter
from services.gait.steps_config import StepConfig

NEAR_S = 0.3  # between a step that is told and the true one
EVERY_S = 0.5  # how often what is told is compared
UP = np.array([0.0, 0.0, 1.0])
AIM_M, AIM_CADENCE = 0.04, 0.03


@dataclass(frozen=True)
class Errors:
    """What was told of one person's steps, compared.

    Args:
        length_m: Of each step, measured minus true.
        mean_m: Of the mean of the last seconds, each time it was told.
        cadence: Relative, likewise.
        found: Steps told for a true one.
        true: Steps truly made between the first and the last that were told.
        extra: Steps told for none.
    """

    length_m: F64
    mean_m: F64
    cadence: F64
    found: int
    true: int
    extra: int


def judge(take: Take, followed: Followed, person: int) -> Errors:
    """Return how well the steps of one person in a film are told."""
    feet = in_map(take, followed.points_m[:, person])
    feet[~followed.measured[:, person]] = np.nan
    falls = take.footfalls[person]
    meter, whole = StepMeter(StepConfig(), UP), StepMeter(StepConfig(window_s=600.0), UP)
    means, cadences, due_s = list[float](), list[float](), 0.0
    for index, points in enumerate(feet):
        t_s = take.world.frame_s(index)
        both = [_known(points[POINTS.index(f"{foot}_foot")]) for foot in FEET]
        told = meter.update(t_s, *both)
        whole.update(t_s, *both)
        if t_s < due_s or told.step_length_m is None or told.cadence_per_min is None:
            continue
        due_s = t_s + EVERY_S
        true = _true_measures(meter.steps(), falls)
        if true is not None:
            means.append(told.step_length_m - true[0])
            cadences.append(told.cadence_per_min / true[1] - 1)
    steps = whole.steps()
    matched = [(step, _match(step, falls)) for step in steps]
    known = [(step, k) for step, k in matched if k is not None]
    lengths = [step.length_m - _length_m(falls, k) for step, k in known if 0 < k < len(falls) - 1]
    numbers = [k for _, k in known]
    true_count = max(numbers) - min(numbers) + 1 if numbers else 0
    return Errors(
        np.array(lengths),
        np.array(means),
        np.array(cadences),
        len(set(numbers)),
        true_count,
        len(steps) - len(set(numbers)),
    )


def table(found: Mapping[str, Sequence[Errors]]) -> str:
    """Return the errors by case; each is of all films and seeds together."""
    header = [
        "case",
        "steps found",
        "told for none",
        "one step: median, p90 cm",
        "mean of the last seconds: bias, median, worst cm",
        "cadence: median, worst %",
    ]
    return markdown(header, [[case, *_cells(errors)] for case, errors in found.items()])


def _cells(errors: Sequence[Errors]) -> list[str]:
    lengths = 100 * np.concatenate([e.length_m for e in errors])
    means = 100 * np.concatenate([e.mean_m for e in errors])
    cadences = 100 * np.abs(np.concatenate([e.cadence for e in errors]))
    count = f"{sum(e.found for e in errors)} of {sum(e.true for e in errors)}"
    if not len(means) or not len(lengths):
        return [count, str(sum(e.extra for e in errors)), "-", "-", "-"]
    size = np.abs(means)
    return [
        count,
        str(sum(e.extra for e in errors)),
        f"{np.median(np.abs(lengths)):.1f}, {np.quantile(np.abs(lengths), 0.9):.1f}",
        f"{means.mean():+.1f}, {np.median(size):.1f}, {size.max():.1f}",
        f"{np.median(cadences):.1f}, {cadences.max():.1f}",
    ]


def _known(point_m: F64) -> F64 | None:
    return point_m if np.isfinite(point_m).all() else None


def _match(step: Step, falls: Sequence[Footfall]) -> int | None:
    """Return the number of the true step that was told."""
    side = FEET.index(step.foot)
    near = [
        (abs(fall.time_s - step.landed_s), k)
        for k, fall in enumerate(falls)
        if fall.side == side and abs(fall.time_s - step.landed_s) < NEAR_S
    ]
    return min(near)[1] if near else None


def _length_m(falls: Sequence[Footfall], k: int) -> float:
    """Return the length of a true step along the way: that of the other foot about it."""
    way = falls[k + 1].place_m - falls[k - 1].place_m
    way = way / max(float(np.linalg.norm(way)), 1e-9)
    return float((falls[k].place_m - falls[k - 1].place_m) @ way)


def _true_measures(steps: Sequence[Step], falls: Sequence[Footfall]) -> tuple[float, float] | None:
    """Return the true mean step length and cadence of the steps that were told."""
    numbers = sorted({k for step in steps if (k := _match(step, falls)) is not None})
    numbers = [k for k in numbers if 0 < k < len(falls) - 1]
    if len(numbers) < 3:
        return None
    lengths = [_length_m(falls, k) for k in numbers]
    sides = [
        [m for m, k in zip(lengths, numbers, strict=True) if falls[k].side == s] for s in (0, 1)
    ]
    times_s = [falls[k].time_s - falls[k - 1].time_s for k in numbers if k - 1 in numbers]
    if not times_s:
        return None
    mean_m = float(np.mean([np.mean(side) for side in sides if side]))
    return mean_m, 60 / float(np.mean(times_s))
