"""Assignment of extremities to points, and of free extremities to points that start."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.geometry.transforms import deproject
from people4d.messages import F64, CameraInfo
from services.gait.points.body import UP, Extremity, MeasuredBody
from services.gait.points.keypoints import KINDS, START_CONFIDENCE, Anchor, pixels_of
from services.gait.points.point_filter import PointFilter

REACH_M = 0.30  # Maximum distance of an extremity from the predicted point [m]
GEODESIC_SIGMA_M = 0.10  # Standard deviation of the geodesic distance of an extremity [m]
NEAR_SIGMA_M = 0.10  # Standard deviation of an extremity about the predicted point [m]
UNASSIGNED_COST = 9.0  # Cost of a point without an extremity [squared deviations]
# Maximum cost of length and prior of a hand without keypoints: its distance along the body is short
# if it touches the hip, and long if it is held before the torso
HAND_COST_MAX = 3.0
SIGMA_MAX_M = 0.2  # Maximum standard deviation of a prediction [m]
PRIOR_FREE = 3.0  # Squared deviation from the body's prior without cost
ARM_MIN = 0.3  # Minimum geodesic distance of fingertips [statures]
START_M = 0.05  # Maximum distance from the body of a keypoint that starts a point [m]
TAKEN_M = 0.12  # Maximum distance of an occupied extremity to a tracked point [m]
TO_CAMERA = np.array([0.0, 0.0, -1.0])  # Default heading
Starts = list[tuple[str, Extremity]]


def assign_extremities(
    points: Mapping[str, PointFilter],
    extremities: Sequence[Extremity],
    expected: Mapping[str, Anchor],
    info: CameraInfo,
) -> dict[str, Extremity]:
    """Assign extremities to the tracked points of their kinds; `expected` are pixels by name."""
    anchors_m = {
        name: deproject(anchor.pixel, motion.position_m[2], info)[0]
        for name, anchor in expected.items()
        if (motion := points[name].motion) is not None
    }
    assigned: dict[str, Extremity] = {}
    for kind in KINDS:
        alive = [point for point in points.values() if point.kind == kind and point.alive]
        same = [one for one in extremities if one.kind == kind]
        assigned |= assign_points(alive, same, anchors_m)
    return assigned


def assign_points(
    points: Sequence[PointFilter],
    extremities: Sequence[Extremity],
    anchors_m: Mapping[str, F64],
) -> dict[str, Extremity]:
    """Assign extremities to points of one kind, one to one, at the minimum cost.

    `anchors_m` are expected positions (3) by keypoints. Unassigned points are absent in the result.
    """
    costs = np.full((len(points), len(extremities) + len(points)), UNASSIGNED_COST)
    for row, point in enumerate(points):
        costs[row, : len(extremities)] = [_cost(point, one, anchors_m) for one in extremities]
    rows, chosen = linear_sum_assignment(costs)
    pairs = zip(rows.tolist(), chosen.tolist(), strict=True)
    return {points[row].name: extremities[k] for row, k in pairs if k < len(extremities)}


def _cost(point: PointFilter, extremity: Extremity, anchors_m: Mapping[str, F64]) -> float:
    if point.motion is None or not point.alive or np.isnan(point.limb_length_m):
        return np.inf
    distance_m = float(np.linalg.norm(extremity.position_m - point.motion.position_m))
    sigma_m = min(point.motion.sigma_m, SIGMA_MAX_M)
    if distance_m > REACH_M + sigma_m:
        return np.inf
    any_pose = point.without_keypoints and point.kind == "hand"
    length2 = ((extremity.geodesic_m - point.limb_length_m) / GEODESIC_SIGMA_M) ** 2
    cost = (distance_m / (NEAR_SIGMA_M + 0.5 * sigma_m)) ** 2
    cost += min(length2, HAND_COST_MAX) if any_pose else length2
    if point.name in anchors_m:
        apart = np.linalg.norm((extremity.position_m - anchors_m[point.name])[:2])
        cost += min(float(apart / NEAR_SIGMA_M) ** 2, 9.0)
    if point.prior is not None:
        off2 = float(point.prior.distances2(extremity.position_m[None])[0])
        cost += min(max(off2 - PRIOR_FREE, 0.0), HAND_COST_MAX if any_pose else UNASSIGNED_COST)
    return float(cost) + 1.0 - extremity.strength


def body_vertex(pixel: F64, body: MeasuredBody, info: CameraInfo) -> int | None:
    """Return the vertex at a keypoint's pixel (2); None if it is not on the body."""
    distances = np.linalg.norm(body.mesh.pixels_px - pixel, axis=1)
    vertex = int(np.argmin(distances))
    near_px = pixels_of(START_M, float(body.mesh.points_m[vertex, 2]), info)
    return vertex if distances[vertex] <= near_px else None


def initial_extremities(
    points: Iterable[PointFilter],
    idle: Sequence[PointFilter],
    extremities: Sequence[Extremity],
    body: MeasuredBody,
    heading: F64 | None,
) -> Starts:
    """Return the extremities at which idle points start, left ones on the left.

    Extremities come the most persistent first; without a heading (3) the person faces the camera.
    """
    left = np.cross(UP, TO_CAMERA if heading is None else heading)
    middle = body.mesh.middle_m
    taken = [point.motion.position_m for point in points if point not in idle and point.motion]
    free = [one for one in extremities if _is_free(one, taken, body)]
    found: Starts = []
    for kind in KINDS:
        waiting = [point for point in idle if point.kind == kind]
        same = [one for one in free if one.kind == kind][: len(waiting)]
        found += _by_side(waiting, same, middle, left)
    return found


def _is_free(extremity: Extremity, taken: Sequence[F64], body: MeasuredBody) -> bool:
    short = extremity.kind == "hand" and extremity.geodesic_m <= ARM_MIN * body.stature_m
    return not short and _is_clear(extremity, taken)


def _is_clear(extremity: Extremity, taken: Sequence[F64]) -> bool:
    near = any(np.linalg.norm(extremity.position_m - point) <= TAKEN_M for point in taken)
    return extremity.strength > START_CONFIDENCE and not near


def _by_side(
    waiting: Sequence[PointFilter], extremities: Sequence[Extremity], middle: F64, left: F64
) -> Starts:
    """Return the starts of one kind; extremities farthest aside are assigned first."""
    found: Starts = []
    asides = {one.basin: float((one.position_m - middle) @ left) for one in extremities}
    for extremity in sorted(extremities, key=lambda one: -abs(asides[one.basin])):
        side = "left" if asides[extremity.basin] > 0 else "right"
        # Of two idle points the point on this side starts; a single idle point has a tracked
        # counterpart.
        for point in waiting:
            sided = len(waiting) == 1 or point.kind == "head" or point.name.startswith(side)
            if sided and _fits(point, extremity):
                found.append((point.name, extremity))
                waiting = [other for other in waiting if other is not point]
                break
    return found


def _fits(point: PointFilter, extremity: Extremity) -> bool:
    """Check for an unchanged length of a limb; a lost point keeps its length."""
    off = abs(extremity.geodesic_m - point.limb_length_m)
    return bool(np.isnan(off) or off < 2.5 * GEODESIC_SIGMA_M)
