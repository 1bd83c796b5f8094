"""Where points start that nobody marks and no keypoints tell: at the ends of limbs."""

from collections.abc import Iterable, Sequence

import numpy as np

from people4d.messages import F64
from services.gait.points.limbs import UP, Body3d, LimbEnd
from services.gait.points.matching import ALONG_SIGMA_M
from services.gait.points.point_filter import PointFilter
from services.gait.points.points import SURE

ARM = 0.3  # of the stature, from the trunk's middle to the fingertips, at least
NEAR_M = 0.12  # [m] of a point to the end that it is taken to be at
TO_CAMERA = np.array([0.0, 0.0, -1.0])  # the way people face of whom nothing is known
Starts = list[tuple[str, LimbEnd]]


def starts(
    points: Iterable[PointFilter],
    idle: Sequence[PointFilter],
    ends: Sequence[LimbEnd],
    body: Body3d,
    facing: F64 | None,
) -> Starts:
    """Return at which ends of limbs points start, left ones on the left.

    Args:
        points: All.
        idle: Those of them that wait for an end.
        ends: Of the body's limbs, those that stand out most first.
        body: Its surface.
        facing: 3, the way the person faces; None: to the camera.
    """
    left = np.cross(UP, TO_CAMERA if facing is None else facing)
    middle = np.median(body.surface.points_m, axis=0)
    taken = [point.motion.position_m for point in points if point not in idle and point.motion]
    found: Starts = []
    for kind in ("head", "hand", "foot"):
        waiting = [point for point in idle if point.kind == kind]
        free = [end for end in ends if end.kind == kind and _is_free(end, taken, body)]
        found += _sided(waiting, free[: len(waiting)], middle, left)
    return found


def _is_free(end: LimbEnd, taken: Sequence[F64], body: Body3d) -> bool:
    short = end.kind == "hand" and end.along_m <= ARM * body.stature_m
    near = any(np.linalg.norm(end.position_m - place) <= NEAR_M for place in taken)
    return end.strength > SURE and not short and not near


def _sided(
    waiting: Sequence[PointFilter], ends: Sequence[LimbEnd], middle: F64, left: F64
) -> Starts:
    """Return which of the points of one kind start where; the ends farthest aside come first."""
    found: Starts = []
    asides = {end.basin: float((end.position_m - middle) @ left) for end in ends}
    for end in sorted(ends, key=lambda end: -abs(asides[end.basin])):
        side = "left" if asides[end.basin] > 0 else "right"
        # Of two that wait the one of that side; one that waits alone is the other one's pair.
        for point in waiting:
            sided = len(waiting) == 1 or point.kind == "head" or point.name.startswith(side)
            if sided and _fits(point, end):
                found.append((point.name, end))
                waiting = [other for other in waiting if other is not point]
                break
    return found


def _fits(point: PointFilter, end: LimbEnd) -> bool:
    """Tell whether a limb is as long as it was; a point keeps that while it is lost."""
    length = point.along_m + np.nan_to_num(point.below_m)
    return bool(np.isnan(length) or abs(end.along_m - length) < 2.5 * ALONG_SIGMA_M)
