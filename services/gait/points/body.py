"""Measurements of a body's mesh: heights, geodesic distances, extremities, the torso.

Source: docs/method.md, section 19.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from people4d.messages import F32, F64, U16, CameraInfo
from services.gait.points.heading import HeadingEstimator
from services.gait.points.keypoints import torso_pixel
from services.gait.surface.floor import FloorPlane
from services.gait.surface.geodesic import GeodesicExtrema, geodesic_extrema, geodesic_m
from services.gait.surface.mesh import BodyMesh
from services.gait.surface.segmentation import I64

UP = np.array([0.0, -1.0, 0.0])  # Upward direction of a level camera
TORSO_RANGE = (0.55, 0.8)  # Range of the torso, from the loins to the armpits [statures]
FOOT_MAX = 0.14  # Maximum height of the end of a leg [statures]
VERTICES_MIN = 30  # Minimum number of vertices of a body
SHRINKAGE = 0.998  # Minimum stature, relative to the previous frame
HEAD_MIN = 0.82  # Minimum height of the end of a head [statures]
HEAD_ASIDE_M = 0.3  # Maximum distance of the head from the axis of the body [m]
HAND_GEODESIC_MIN_M = 0.3  # Minimum distance of a hand to the middle of the torso [m]

BOTTOM = 0.94  # Maximum row of the end of a leg that the image does not cut off [heights]
# Distance along the body from the end of a limb (fingertips, toes, top of the head) to the middle
# of its point [m]
LENGTHS_M: Mapping[str, float] = MappingProxyType({"head": 0.17, "hand": 0.09, "foot": 0.10})
WINDOW_M = 0.06  # Radius of the average of a position [m]


@dataclass(frozen=True)
class MeshObservation:
    """Observation of one person in a frame."""

    mesh: BodyMesh | None  # mesh of the body; None: not visible
    dt_s: float  # [s] time since the last frame
    keypoints: F32 | None = None  # 17x3: u, v, confidence, COCO order
    floor: FloorPlane | None = None
    depth_mm: U16 | None = None  # HxW, the entire image; 0: no reading
    fixed_from_optical: F64 = field(default_factory=lambda: np.eye(4))  # 4x4, the camera's pose
    yaw_rad: float | None = None  # [rad] of the chest in the fixed frame


@dataclass(frozen=True)
class MeasuredBody:
    """One person's mesh with measurements of its V vertices."""

    mesh: BodyMesh
    heights_m: F64  # V, above the floor, or above the lowest vertex if the floor is unknown
    stature_m: float
    geodesic_m: F64  # V, distance along the mesh from the source; inf: not connected
    extrema: GeodesicExtrema
    kinds: tuple[str, ...]  # kinds of the extrema: head, hand, foot or empty
    tip_distance_m: F64  # V, geodesic distance to the extremum that a vertex leads up to


@dataclass(frozen=True)
class Extremity:
    """Head, hand or foot: the end of a limb."""

    basin: int  # number of the extremum
    kind: str  # head, hand or foot
    position_m: F64  # 3, middle of the point
    geodesic_m: float  # geodesic distance of its extremum
    strength: float  # persistence, 0 to 1


def heights_of(mesh: BodyMesh, floor: FloorPlane | None) -> F64:
    """Return the heights of vertices above the floor, V metres."""
    if floor is not None:
        return floor.heights_m(mesh.points_m)
    rise = mesh.points_m @ UP
    return np.asarray(rise - rise.min()) if len(rise) else rise


def torso_vertices(heights_m: F64, stature_m: float) -> I64:
    """Return the vertices between loins and armpits, or all vertices if there are none."""
    low, high = (ratio * stature_m for ratio in TORSO_RANGE)
    found = np.flatnonzero((heights_m > low) & (heights_m < high))
    return found if len(found) else np.arange(len(heights_m))


def extremity_kinds(
    vertices: I64, mesh: BodyMesh, heights_m: F64, stature_m: float
) -> tuple[str, ...]:
    """Classify extrema by height; the highest one near the body's axis is the head."""
    middle = mesh.middle_m
    kinds = ["hand"] * len(vertices)
    best = -1
    for k, vertex in enumerate(vertices):
        height = heights_m[vertex]
        aside = abs(mesh.points_m[vertex, 0] - middle[0])
        if height < FOOT_MAX * stature_m:
            kinds[k] = "foot"
        elif height > HEAD_MIN * stature_m and aside < HEAD_ASIDE_M:
            kinds[k] = ""
            if best < 0 or height > heights_m[vertices[best]]:
                best = k
    if best >= 0:
        kinds[best] = "head"
    return tuple(kinds)


def measure_body(
    mesh: BodyMesh, heights_m: F64, stature_m: float, geodesic_m: F64, extrema: GeodesicExtrema
) -> MeasuredBody:
    """Return a mesh with its measurements and the kinds of its extrema."""
    tips = np.append(geodesic_m[extrema.vertices], np.nan)  # last element: basin -1
    tip_distance = np.nan_to_num(tips[extrema.basin] - geodesic_m, nan=np.inf)
    kinds = extremity_kinds(extrema.vertices, mesh, heights_m, stature_m)
    return MeasuredBody(mesh, heights_m, stature_m, geodesic_m, extrema, kinds, tip_distance)


def extremities_in_view(body: MeasuredBody, info: CameraInfo) -> list[Extremity]:
    """Return the extremities that are not cut off by the image."""
    margin = 2 * body.mesh.step_px
    last = np.array([info.width - 1 - margin, BOTTOM * info.height])
    pixels = body.mesh.pixels_px[body.extrema.vertices]
    inside = np.all((pixels > margin) & (pixels < last), axis=1)
    return [one for one in find_extremities(body) if inside[one.basin]]


def find_extremities(body: MeasuredBody) -> list[Extremity]:
    """Return heads, hands and feet, the most persistent first."""
    found = []
    for k, kind in enumerate(body.kinds):
        geodesic = float(body.geodesic_m[body.extrema.vertices[k]])
        if not kind or (kind == "hand" and geodesic < HAND_GEODESIC_MIN_M):
            continue
        near = (body.extrema.basin == k) & (body.tip_distance_m <= 2 * LENGTHS_M[kind])
        points = body.mesh.points_m[near]
        # Middle, since a mean is biased to the nearer side of a limb, which has more vertices.
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        distances = np.linalg.norm(points - middle, axis=1)
        position = points[distances <= distances.min() + WINDOW_M / 2].mean(axis=0)
        found.append(Extremity(k, kind, position, geodesic, float(body.extrema.strengths[k])))
    return sorted(found, key=lambda one: -one.strength)


def torso_vertex(mesh: BodyMesh, heights_m: F64, stature_m: float, keypoints: F32 | None) -> int:
    """Return the vertex at the middle of the torso, by keypoints if they are confident."""
    torso = torso_vertices(heights_m, stature_m)
    pixel = torso_pixel(keypoints)
    if pixel is None:
        pixel = np.median(mesh.pixels_px[torso], axis=0)
    distances_px = np.linalg.norm(mesh.pixels_px[torso] - pixel, axis=1)
    return int(torso[int(np.argmin(distances_px))])


class BodyMeter:
    """Measures one person's body; stature and heading persist between frames."""

    def __init__(self) -> None:
        self._heading = HeadingEstimator()
        self.heading: F64 | None = None  # 3, level, optical frame
        self.stature_m = 0.0

    def measure_body(
        self, observation: MeshObservation, source_vertex: Callable[[BodyMesh, F64], int]
    ) -> MeasuredBody | None:
        """Return the body of a frame; None if it is not visible.

        `source_vertex` maps mesh and heights to the source of geodesic distances.
        """
        mesh, pose = observation.mesh, observation.fixed_from_optical
        visible = mesh is not None and len(mesh.points_m) >= VERTICES_MIN
        heights_m = heights_of(mesh, observation.floor) if mesh and visible else np.empty(0)
        self.heading = self._heading.update_heading(
            mesh if visible else None, heights_m, observation.dt_s, pose, observation.yaw_rad
        )
        if mesh is None or not visible:
            return None
        top_m = float(np.quantile(heights_m, 0.995))
        self.stature_m = max(SHRINKAGE * self.stature_m, top_m)
        distances_m = geodesic_m(mesh, source_vertex(mesh, heights_m))
        extrema = geodesic_extrema(mesh, distances_m)
        return measure_body(mesh, heights_m, self.stature_m, distances_m, extrema)
