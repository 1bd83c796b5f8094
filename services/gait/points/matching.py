"""Which end of a limb is which point."""

from collections.abc import Mapping, Sequence
from itertools import permutations

import numpy as np

from people4d.messages import F64
from services.gait.points.limbs import LimbEnd
from services.gait.points.point_filter import PointFilter

REACH_M = 0.30  # from where a point is expected to where its limb ends, at most
ALONG_SIGMA_M = 0.10  # of the distance of a tip along the body
NEAR_SIGMA_M = 0.10  # of an end about where its point is expected
NONE_COST = 9.0  # of a point that has no end


def match(
    points: Sequence[PointFilter], ends: Sequence[LimbEnd], anchors_m: Mapping[str, F64]
) -> dict[str, LimbEnd]:
    """Give ends of limbs to points, each to one at most, at the least cost.

    Args:
        points: All of one kind.
        ends: Of the same kind.
        anchors_m: 3 each, where keypoints put points, by their names.

    Returns:
        By the names of points; those that have no end are absent.
    """
    costs = np.array([[_cost(point, end, anchors_m) for end in ends] for point in points])
    choices = [*range(len(ends)), *([-1] * len(points))]
    best: tuple[int, ...] = (-1,) * len(points)
    least = NONE_COST * len(points)
    for chosen in set(permutations(choices, len(points))):
        cost = sum(
            NONE_COST if column < 0 else costs[row, column] for row, column in enumerate(chosen)
        )
        if cost < least - 1e-9 or (cost < least + 1e-9 and chosen > best):
            best, least = chosen, min(cost, least)
    return {
        point.name: ends[column] for point, column in zip(points, best, strict=True) if column >= 0
    }


def _cost(point: PointFilter, end: LimbEnd, anchors_m: Mapping[str, F64]) -> float:
    if point.motion is None or not point.alive:
        return np.inf
    away = float(np.linalg.norm(end.position_m - point.motion.position_m))
    reach = REACH_M + min(point.motion.spread_m, 0.2)
    if away > reach:
        return np.inf
    cost = (away / (NEAR_SIGMA_M + 0.5 * min(point.motion.spread_m, 0.2))) ** 2
    expected = point.along_m + np.nan_to_num(point.below_m)
    cost += ((end.along_m - expected) / ALONG_SIGMA_M) ** 2
    if point.name in anchors_m:
        apart = np.linalg.norm((end.position_m - anchors_m[point.name])[:2])
        cost += min(float(apart / NEAR_SIGMA_M) ** 2, 9.0)
    return float(cost) + 1.0 - end.strength
