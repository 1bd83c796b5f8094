"""The depth layer: points of one person's body tracked in depth (docs/method.md, section 19)."""

from collections.abc import Mapping, Sequence

from people4d.messages import F32, F64, CameraInfo
from services.gait.config import DepthLayerConfig
from services.gait.points.acceptance import Acceptance
from services.gait.points.assignment import assign_extremities, body_vertex, initial_extremities
from services.gait.points.body import (
    UP,
    Extremity,
    MeasuredBody,
    MeshObservation,
    extremities_in_view,
    torso_vertex,
)
from services.gait.points.keypoints import (
    COUNTERPARTS,
    POINTS,
    START_CONFIDENCE,
    Anchor,
    KeypointTrust,
    feet_ahead,
    find_anchors,
    joint_pixels,
)
from services.gait.points.limbs.anchors import keep_own_limbs
from services.gait.points.limbs.ends import end_position
from services.gait.points.limbs.floor_feet import correct_by_floor, floor_positions
from services.gait.points.limbs.prior import limb_priors
from services.gait.points.limbs.surface import (
    SurfacePosition,
    head_position,
    nearest_position,
    surface_position,
)
from services.gait.points.limbs.visibility import PointEvidence
from services.gait.points.normal import Normal
from services.gait.points.point_filter import (
    TIMEOUT_S,
    PointEstimate,
    PointFilter,
    PointLayer,
    damp_occluded,
)


class DepthLayer(PointLayer[PointFilter]):
    """Tracks the points of one person by keypoints, ends of limbs and the expected body.

    Source: docs/method.md, section 19.
    """

    def __init__(self, config: DepthLayerConfig, info: CameraInfo) -> None:
        super().__init__(info, map(PointFilter, POINTS))
        self._config = config
        self._up: F64 = UP
        self._acceptance = Acceptance(info)
        self._trust = KeypointTrust()
        self._assigned: dict[str, Extremity] = {}  # assigned extremity by point
        self._floor_feet: Mapping[str, SurfacePosition] = {}  # positions of feet without depth

    def update_points(self, observation: MeshObservation) -> Mapping[str, PointEstimate]:
        """Return the estimates of the points in the next frame."""
        dt_s = observation.dt_s
        self._acceptance.trusts_keypoints = self._config.keypoints and self._trust.update(
            observation.keypoints
        )
        has_keypoints = self._keypoints(observation) is not None
        self._acceptance.has_keypoints = has_keypoints
        self._up = UP if observation.floor is None else observation.floor.up
        body = self._measure(observation)
        self._expect(body, observation)
        if body is None:
            for point in self._points.values():
                if point.motion is not None:
                    point.motion.predict(dt_s)
                point.mark_missed(dt_s)
            return self._estimates()
        anchors = self._anchors(observation, body)
        extremities = extremities_in_view(body, self._info)
        self._assigned = assign_extremities(self._points, extremities, anchors, self._info)
        self._floor_feet = floor_positions(
            anchors, self._points, observation, self._meter.heading, self._info
        )
        for point in self._points.values():
            if point.motion is not None:
                point.motion.predict(dt_s)
        self._measure_points(dt_s, body, anchors)
        damp_occluded(self._points, dt_s)
        self._start_points(has_keypoints, body, anchors, extremities)
        return self._estimates()

    def _keypoints(self, observation: MeshObservation) -> F32 | None:
        """Return the keypoints of a frame if they are trusted."""
        return observation.keypoints if self._acceptance.trusts_keypoints else None

    def _measure(self, observation: MeshObservation) -> MeasuredBody | None:
        """Measure the body; geodesic distances begin at the middle of the torso."""
        keypoints = self._keypoints(observation)
        return self._meter.measure_body(
            observation,
            lambda mesh, heights_m: torso_vertex(mesh, heights_m, self._meter.stature_m, keypoints),
        )

    def _expect(self, body: MeasuredBody | None, observation: MeshObservation) -> None:
        """Set the expected positions of the points relative to the body."""
        priors: Mapping[str, Normal] = {}
        if body is not None:
            joints = joint_pixels(self._keypoints(observation))
            priors = limb_priors(body, self._meter.heading, self._up, joints, self._info)
        for name, point in self._points.items():
            point.prior = priors.get(name)
            point.without_keypoints = not self._acceptance.trusts_keypoints

    def _anchors(self, observation: MeshObservation, body: MeasuredBody) -> Mapping[str, Anchor]:
        found = find_anchors(self._keypoints(observation))
        if self._meter.heading is not None:
            depth_m = float(body.mesh.middle_m[2])
            found = feet_ahead(found, depth_m, self._meter.heading, self._info)
        return keep_own_limbs(found, self._points, observation.dt_s, self._info)

    def _measure_points(
        self, dt_s: float, body: MeasuredBody, anchors: Mapping[str, Anchor]
    ) -> None:
        """Update all points by their positions on the surface, or on the floor."""
        points = [point for point in self._points.values() if point.motion is not None]
        surfaces = [self._position(point, body, anchors) for point in points]
        for point, surface in zip(points, surfaces, strict=True):
            name, floor = point.name, self._floor_feet.get(point.name)
            if floor is not None and surface is None and point.alive:
                correct_by_floor(point, floor, dt_s)
                continue
            other = self._points.get(COUNTERPARTS.get(name, ""))
            evidence = PointEvidence(anchors.get(name), other, self._assigned.get(name), surface)
            self._acceptance.update_point(point, body, evidence, dt_s)

    def _position(
        self, point: PointFilter, body: MeasuredBody, anchors: Mapping[str, Anchor]
    ) -> SurfacePosition | None:
        """Return the measured position of a point."""
        anchor, end = anchors.get(point.name), self._assigned.get(point.name)
        around = (body, self._meter.heading, self._up)
        if point.kind == "head":
            return head_position(anchor, end, body, self._info)
        if self._acceptance.trusts_keypoints:
            return surface_position(point.name, anchor, *around, self._info)
        return end_position(point.name, end, *around) or nearest_position(point, body)

    def _start_points(
        self,
        has_keypoints: bool,
        body: MeasuredBody,
        anchors: Mapping[str, Anchor],
        extremities: Sequence[Extremity],
    ) -> None:
        """Start lost points at keypoints; if there are none, at the ends of limbs."""
        for name, point in self._points.items():
            anchor = anchors.get(name)
            if point.alive or anchor is None or anchor.confidence < START_CONFIDENCE:
                continue
            vertex, floor = body_vertex(anchor.pixel, body, self._info), self._floor_feet.get(name)
            if vertex is not None:
                self._start_at(point, vertex, body)
            elif floor is not None:
                point.start_beside(floor.position_m, floor.noise_m2)
        if has_keypoints:
            return
        points = self._points.values()
        idle = [one for one in points if not one.alive or one.unsupported_s > TIMEOUT_S]
        for name, one in initial_extremities(points, idle, extremities, body, self._meter.heading):
            self._start_at(self._points[name], body.mesh.nearest(one.position_m), body)

    def _start_at(self, point: PointFilter, vertex: int, body: MeasuredBody) -> None:
        """Start a point at a vertex, unless the surface there hides it."""
        position_m = body.mesh.points_m[vertex]
        if point.state == "measured" or not self._acceptance.is_hidden(point, position_m, None):
            point.start_at_vertex(vertex, body)
            if self._acceptance.trusts_keypoints:
                point.state = "predicted"  # until confirmed by the next frame
