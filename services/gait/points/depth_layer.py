"""The depth layer: points of one person's body tracked in depth (docs/method.md, section 8.3)."""

from collections.abc import Mapping, Sequence

import numpy as np

from people4d.messages import F32, F64, CameraInfo
from services.gait.config import DepthLayerConfig
from services.gait.points.acceptance import Acceptance, drop_same
from services.gait.points.assignment import (
    assign_extremities,
    body_vertex,
    expected_starts,
    initial_extremities,
    is_idle,
)
from services.gait.points.body import (
    LENGTHS_M,
    UP,
    Extremity,
    MeasuredBody,
    MeshObservation,
    TorsoReference,
    extremities_in_view,
    heights_of,
    measure_body,
)
from services.gait.points.heading import HeadingEstimator, LeftRightCheck
from services.gait.points.keypoints import (
    COUNTERPARTS,
    START_CONFIDENCE,
    Anchor,
    feet_ahead,
    find_anchors,
    joint_pixels,
    sigma_px,
)
from services.gait.points.likelihood import (
    PointEvidence,
    combined_weights,
    reference_spin_image,
    single_feature_weights,
    spin_similarities,
)
from services.gait.points.limbs.anchors import feet_apart, keep_own_limbs
from services.gait.points.limbs.ends import end_position
from services.gait.points.limbs.floor_feet import FloorPosition, correct_by_floor, floor_positions
from services.gait.points.limbs.prior import limb_priors
from services.gait.points.limbs.surface import surface_position
from services.gait.points.normal import Normal
from services.gait.points.occlusion import damp_occluded
from services.gait.points.point_filter import PointEstimate, PointFilter
from services.gait.surface.geodesic import geodesic_extrema, geodesic_m
from services.gait.surface.mesh import BodyMesh

VERTICES_MIN = 30  # Minimum number of vertices of a body
CONTRADICTIONS_MAX = 2  # Maximum number of frames with a contradicting keypoint before a restart
MARKED_TIP_MAX_M = 0.4  # Maximum distance of a marked point to the end of its limb [m]


class DepthLayer:
    """Tracks the points of one person.

    Source: docs/method.md, sections 8.3 and 19.
    """

    def __init__(self, config: DepthLayerConfig, info: CameraInfo, seed: int = 0) -> None:
        self._config, self._info = config, info
        self._generator = np.random.default_rng(seed)
        self._torso = TorsoReference()
        self._heading_estimator = HeadingEstimator()
        self._heading: F64 | None = None  # 3, level, optical frame
        self._up: F64 = UP
        self._points = {name: self._new(name) for name in config.points}
        self._acceptance = Acceptance(config, info)
        self._left_right = LeftRightCheck()
        self._assigned: dict[str, Extremity] = {}  # by point
        self._floor_feet: Mapping[str, FloorPosition] = {}  # of feet without depth
        self._stature_m = 0.0
        self._combined = config.feature == "combined"

    @property
    def filters(self) -> Mapping[str, PointFilter]:
        """The particle filters by the names of their points."""
        return self._points

    def start_point(self, name: str, point_m: F64, observation: MeshObservation) -> bool:
        """Track a point from the vertex nearest to a position (3, optical frame) on.

        An unknown name adds a point. Returns True if there is a body.
        """
        body = self._measure(observation)
        if body is None or not np.all(np.isfinite(point_m)):
            return False
        vertex = body.mesh.nearest(point_m)
        self._start(name, vertex, body)
        point, basin = self._points[name], body.extrema.basin[vertex]
        if basin >= 0:
            tip_distance = float(body.tip_distance_m[vertex])
            own_limb = body.kinds[basin] == point.kind and tip_distance < MARKED_TIP_MAX_M
            point.tip_distance_m = tip_distance if own_limb else np.nan
        return True

    def update_points(self, observation: MeshObservation) -> Mapping[str, PointEstimate]:
        """Return the estimates of the points in the next frame."""
        has_keypoints = self._keypoints(observation) is not None
        self._acceptance.has_keypoints = has_keypoints
        self._acceptance.had_keypoints |= has_keypoints
        self._up = UP if observation.floor is None else observation.floor.up
        body = self._measure(observation)
        self._expect(body, observation)
        if body is None:
            for point in self._points.values():
                if point.motion is not None:
                    point.motion.predict(observation.dt_s)
                point.mark_missed(observation.dt_s)
            return self._estimates()
        expected = self._anchors(observation, body)
        starts = any(point.motion is None for point in self._points.values())
        extremities = extremities_in_view(body, self._info) if self._combined or starts else []
        self._assigned = assign_extremities(self._points, extremities, expected, self._info)
        self._floor_feet = floor_positions(
            expected, self._points, observation, self._heading, self._info
        )
        self._propagate(observation.dt_s, expected)
        self._measure_points(observation.dt_s, body, expected)
        if self._combined:
            damp_occluded(self._points, observation.dt_s)
        self._start_points(observation, body, expected, extremities)
        if not expected and self._combined:
            pairs = self._left_right.find_swapped(self._points, self._heading, observation.dt_s)
            for left, right in pairs:
                self._swap(left, right)
        return self._estimates()

    def predict_points(self, dt_s: float) -> Mapping[str, PointEstimate]:
        """Return the estimates after some time without an observation."""
        return {name: point.predict_estimate(dt_s) for name, point in self._points.items()}

    def mark_lost(self) -> None:
        """Set all points lost, after a gap in time."""
        for point in self._points.values():
            point.state = "lost"

    def _keypoints(self, observation: MeshObservation) -> F32 | None:
        """Return the keypoints of a frame if they are used."""
        return observation.keypoints if self._config.keypoints else None

    def _new(self, name: str) -> PointFilter:
        return PointFilter(name, self._config, self._info, self._generator)

    def _estimates(self) -> dict[str, PointEstimate]:
        return feet_apart({name: point.estimate() for name, point in self._points.items()})

    def _measure(self, observation: MeshObservation) -> MeasuredBody | None:
        """Measure heights, geodesic distances and extrema of the body."""
        mesh, config = observation.mesh, self._config
        if mesh is None or len(mesh.points_m) < VERTICES_MIN:
            self._set_heading(observation, None, np.empty(0))
            return None
        heights = heights_of(mesh, observation.floor)
        self._set_heading(observation, mesh, heights)
        self._stature_m = max(0.998 * self._stature_m, float(np.quantile(heights, 0.995)))
        if self._combined or config.source == "body":
            source = self._torso.find_vertex(
                mesh, heights, self._stature_m, self._keypoints(observation)
            )
        else:
            source = int(np.argmax(heights))
        distances = geodesic_m(mesh, source)
        extrema = geodesic_extrema(mesh, distances)
        return measure_body(mesh, heights, self._stature_m, distances, extrema)

    def _set_heading(
        self, observation: MeshObservation, mesh: BodyMesh | None, heights_m: F64
    ) -> None:
        pose, yaw_rad = observation.fixed_from_optical, observation.yaw_rad
        self._heading = self._heading_estimator.update_heading(
            mesh, heights_m, observation.dt_s, pose, yaw_rad
        )

    def _expect(self, body: MeasuredBody | None, observation: MeshObservation) -> None:
        """Set the expected positions of the points relative to the body."""
        priors: Mapping[str, Normal] = {}
        if body is not None and self._combined and self._config.body_prior:
            joints = joint_pixels(self._keypoints(observation))
            priors = limb_priors(body, self._heading, self._up, joints, self._info)
        for name, point in self._points.items():
            point.prior, point.hidden_keypoint = priors.get(name), None
            point.without_keypoints = not self._acceptance.had_keypoints

    def _anchors(self, observation: MeshObservation, body: MeasuredBody) -> Mapping[str, Anchor]:
        if not (self._combined and self._config.keypoints):
            return {}
        found = find_anchors(observation.keypoints)
        if self._heading is not None:
            depth_m = float(body.mesh.middle_m[2])
            found = feet_ahead(found, depth_m, self._heading, self._info)
        found = {name: anchor for name, anchor in found.items() if name in self._points}
        return keep_own_limbs(found, self._points, observation.dt_s, self._info)

    def _propagate(self, dt_s: float, expected: Mapping[str, Anchor]) -> None:
        for name, point in self._points.items():
            if point.motion is not None:
                proposals = (
                    point.proposals(expected.get(name), self._assigned.get(name))
                    if self._combined
                    else []
                )
                point.move_particles(dt_s, proposals)

    def _measure_points(
        self, dt_s: float, body: MeasuredBody, expected: Mapping[str, Anchor]
    ) -> None:
        """Weigh the particles of all points, and update the points by them."""
        points = [point for point in self._points.values() if point.motion is not None]
        for point in points:
            point.project_particles(body)
        # Before any update: the evidence of a point contains its counterpart's prediction.
        evidence = [self._evidence(point, body, expected.get(point.name)) for point in points]
        similarities = spin_similarities(points, body.mesh)
        weights = [
            combined_weights(point, body, similar, own)
            if self._combined
            else single_feature_weights(point, body, similar)
            for point, similar, own in zip(points, similarities, evidence, strict=True)
        ]
        candidates = {
            point.name: self._acceptance.measure_candidate(point, body, weighted, own.surface)
            for point, weighted, own in zip(points, weights, evidence, strict=True)
        }
        if self._combined:
            drop_same(candidates, self._points)
        for point, own in zip(points, evidence, strict=True):
            floor = self._floor_feet.get(point.name)
            if floor is not None and own.surface is None and point.alive:
                correct_by_floor(point, floor, dt_s)
            else:
                self._acceptance.update_point(point, body, candidates[point.name], own, dt_s)

    def _evidence(
        self, point: PointFilter, body: MeasuredBody, anchor: Anchor | None
    ) -> PointEvidence:
        assert point.motion is not None
        depth_m = point.motion.position_m[2]
        noise_px = sigma_px(anchor, depth_m, self._info) if anchor else 1.0
        other = self._points.get(COUNTERPARTS.get(point.name, ""))
        taken = self._assigned.get(other.name) if other is not None else None
        own = self._assigned.get(point.name)
        surface = None
        if point.kind in ("hand", "foot") and self._combined:
            around = (body, self._heading, self._up)
            surface = (
                surface_position(point.name, anchor, *around, self._info)
                if self._acceptance.had_keypoints
                else end_position(point.name, own, *around)
            )
        return PointEvidence(anchor, noise_px, other, own, taken, surface)

    def _start_points(
        self,
        observation: MeshObservation,
        body: MeasuredBody,
        expected: Mapping[str, Anchor],
        extremities: Sequence[Extremity],
    ) -> None:
        """Start untracked points, and points with contradicting keypoints."""
        for name, point in self._points.items():
            lost = point.motion is None or (self._combined and point.state == "lost")
            anchor = expected.get(name)
            if anchor is None or anchor.confidence < START_CONFIDENCE:
                continue
            if lost or point.contradicted > CONTRADICTIONS_MAX:
                vertex = body_vertex(anchor.pixel, body, self._info)
                floor = self._floor_feet.get(name)
                if vertex is not None:
                    self._start_at(name, vertex, body)
                elif floor is not None:
                    point.start_beside(anchor.pixel, floor.position_m, floor.noise_m2)
        if self._combined and self._keypoints(observation) is not None:
            for name, one in expected_starts(self._points, extremities):
                self._start_at(name, body.mesh.nearest(one.position_m), body)
            return
        points = self._points.values()
        idle = [point for point in points if is_idle(point, self._config)]
        for name, one in initial_extremities(points, idle, extremities, body, self._heading):
            self._start_at(name, body.mesh.nearest(one.position_m), body)

    def _start_at(self, name: str, vertex: int, body: MeasuredBody) -> None:
        if self._is_possible(name, body.mesh.points_m[vertex]):
            self._start(name, vertex, body)
            if self._acceptance.had_keypoints:
                self._points[name].state = "predicted"  # until the next frame agrees

    def _is_possible(self, name: str, position_m: F64) -> bool:
        """Check that the surface at a position does not hide a point that would start there."""
        point = self._points[name]
        if point.state == "measured":
            return True
        return not self._acceptance.is_hidden(point, position_m, None)

    def _start(self, name: str, vertex: int, body: MeasuredBody) -> None:
        point = self._points.setdefault(name, self._new(name))
        spin = reference_spin_image(point, vertex, body.mesh, self._config)
        point.start_at_vertex(vertex, body, spin)
        point.tip_distance_m = LENGTHS_M.get(point.kind, np.nan)

    def _swap(self, left: str, right: str) -> None:
        points = self._points
        points[left], points[right] = points[right], points[left]
        points[left].name, points[right].name = left, right
