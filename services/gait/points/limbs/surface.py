"""Positions of points by the surface behind their keypoints.

Wrists and ankles are the most precise keypoints, and their depth is the depth of the limb. The
middle of the hand is beyond the wrist, the middle of the foot ahead of the ankle, each halfway to
the surface there.

Source: docs/method.md, section 19.
"""

from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import deproject, project
from people4d.messages import F64, CameraInfo
from services.gait.points.body import Extremity, MeasuredBody
from services.gait.points.keypoints import Anchor, kind_of
from services.gait.points.point_filter import NOISE_M as VERTEX_NOISE_M
from services.gait.points.point_filter import PointFilter

# Candidate offsets from the wrist to the middle of the hand, the first one on the body counts
# [forearms]
HAND_REACHES = np.array([0.4, 0.2])
ANKLE_DEEP_M = 0.055  # Depth of the ankle behind its surface [m]
# Offset from the ankle to the surface at the middle of the foot: ahead, down, to the camera [m]
FOOT_AHEAD_M, FOOT_BELOW_M, FOOT_NEAR_M = 0.08, 0.03, 0.03
FOOT_AWAY = 0.4  # Minimum cosine of heading and ray of a foot with a visible heel
AROUND_PX = np.array([(0, 0), (-3, 0), (3, 0), (0, -3), (0, 3)])  # Offsets of sampled pixels
NOISE_M, UNSURE_M = 0.012, 0.018  # Noise of a keypoint, and addition at confidence 0 [m]
LIMB_DEEP_M = 0.12  # Maximum depth between wrist and hand, or foot and surface [m]
HEAD_NOISE_M = 0.03  # Noise of a head [m]
ALONG_M = 0.08  # Standard deviation of the distance along the body [m]
# Maximum cost of a position by the distance along the body, and cost of another kind of limb
# [squared deviations]
COST_MAX, WRONG_COST = 16.0, 9.0
DEPTH_NOISE_M = 0.018  # Noise of the depth of a limb, which is round [m]


@dataclass(frozen=True)
class SurfacePosition:
    """Measured position of a point by the surface of the body."""

    position_m: F64  # 3, optical frame
    noise_m2: F64  # 3x3, without the noise of depth
    vertex: int  # vertex at the keypoint or the end of the limb; -1: on the floor
    by_distance: bool = False  # True: known by the distance along the body alone


def surface_position(
    name: str,
    anchor: Anchor | None,
    body: MeasuredBody,
    heading: F64 | None,
    up: F64,
    info: CameraInfo,
) -> SurfacePosition | None:
    """Return the position of a hand or foot; None if no keypoint is on the body.

    `heading` and `up` are unit vectors in the optical frame.
    """
    if anchor is None or anchor.joint is None:
        return None
    beyond_px = _beyond_px(name, anchor)
    found = body.mesh.vertices_at(np.concatenate([anchor.joint + AROUND_PX, beyond_px]))
    vertices, beyond = found[: len(AROUND_PX)], found[len(AROUND_PX) :]
    vertices = vertices[vertices >= 0]
    if not len(vertices):
        return None
    depth_m = float(np.sort(body.mesh.points_m[vertices, 2])[len(vertices) // 2])
    joint_m = deproject(anchor.joint, depth_m, info)[0]
    ray = joint_m / np.linalg.norm(joint_m)
    if kind_of(name) == "hand":
        deep_m = np.abs(body.mesh.points_m[beyond, 2] - depth_m)
        there = np.flatnonzero((beyond >= 0) & (deep_m < LIMB_DEEP_M))
        pixel = beyond_px[there[0]] if len(there) else anchor.joint
        # The forearm may point to the camera or away from it: the hand is halfway.
        own_m = float(body.mesh.points_m[beyond[there[0]], 2]) if len(there) else depth_m
        position_m = deproject(pixel, (depth_m + own_m) / 2, info)[0]
    else:
        position_m = joint_m + (ANKLE_DEEP_M - FOOT_NEAR_M) * ray - FOOT_BELOW_M * up
        if heading is not None:
            position_m = position_m + FOOT_AHEAD_M * heading
        if heading is None or float(heading @ ray) < FOOT_AWAY:
            position_m = _nearer_to_surface(position_m, body, info)
    sigma_m = NOISE_M + UNSURE_M * (1.0 - anchor.confidence)
    noise_m2 = sigma_m**2 * np.eye(3) + DEPTH_NOISE_M**2 * np.outer(ray, ray)
    return SurfacePosition(position_m, noise_m2, int(vertices[0]))


def head_position(
    anchor: Anchor | None, extremity: Extremity | None, body: MeasuredBody, info: CameraInfo
) -> SurfacePosition | None:
    """Return the position of a head by the surface at the face, or by its extremity."""
    if anchor is not None:
        vertices = body.mesh.vertices_at(anchor.pixel + AROUND_PX)
        vertices = vertices[vertices >= 0]
        if len(vertices):
            depth_m = float(np.sort(body.mesh.points_m[vertices, 2])[len(vertices) // 2])
            position_m = deproject(anchor.pixel, depth_m, info)[0]
            return SurfacePosition(position_m, HEAD_NOISE_M**2 * np.eye(3), int(vertices[0]))
    if extremity is None:
        return None
    vertex = body.mesh.nearest(extremity.position_m)
    return SurfacePosition(extremity.position_m, HEAD_NOISE_M**2 * np.eye(3), vertex)


def nearest_position(point: PointFilter, body: MeasuredBody) -> SurfacePosition | None:
    """Return the position of the vertex near the prediction at the same distance along the body."""
    if point.motion is None or not np.isfinite(point.geodesic_m):
        return None
    points_m = body.mesh.points_m
    costs = np.minimum(((body.geodesic_m - point.geodesic_m) / ALONG_M) ** 2, COST_MAX)
    costs += point.motion.distances2(points_m, point.noise_m2(point.motion.position_m))
    if point.prior is not None:
        costs += np.minimum(point.prior.distances2(points_m), COST_MAX)
    of_kind = np.array([*(kind == point.kind for kind in body.kinds), False])
    costs[~of_kind[body.extrema.basin]] += WRONG_COST
    vertex = int(np.argmin(costs))
    if costs[vertex] >= COST_MAX:
        return None
    return SurfacePosition(points_m[vertex], VERTEX_NOISE_M**2 * np.eye(3), vertex, True)


def _nearer_to_surface(position_m: F64, body: MeasuredBody, info: CameraInfo) -> F64:
    """Return a position (3) moved halfway to the surface on its ray if the surface is near."""
    vertices = body.mesh.vertices_at(project(position_m, info)[0] + AROUND_PX)
    vertices = vertices[vertices >= 0]
    if not len(vertices):
        return position_m
    depth_m = float(np.sort(body.mesh.points_m[vertices, 2])[len(vertices) // 2])
    if abs(depth_m - position_m[2]) >= LIMB_DEEP_M:
        return position_m
    return np.asarray(position_m * (0.5 + 0.5 * depth_m / position_m[2]))


def _beyond_px(name: str, anchor: Anchor) -> F64:
    """Return candidate pixels of the middle of a hand, Nx2; empty for other points."""
    if kind_of(name) != "hand" or anchor.joint is None or anchor.before is None:
        return np.empty((0, 2))
    return np.asarray(anchor.joint + HAND_REACHES[:, None] * (anchor.joint - anchor.before))
