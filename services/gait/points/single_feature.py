"""Particle filters of points by one feature, spin images or geodesic distances, as published.

Source: docs/method.md, section 8.3.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from people4d.messages import F64, CameraInfo
from services.gait.config import DepthLayerConfig
from services.gait.particles import FIRST, resample_systematic
from services.gait.points.assignment import initial_extremities
from services.gait.points.body import MeasuredBody, MeshObservation, extremities_in_view
from services.gait.points.keypoints import POINTS
from services.gait.points.point_filter import PointEstimate, PointFilter, PointLayer
from services.gait.surface.mesh import BodyMesh
from services.gait.surface.spin_image import SIMILARITY_SIGMA, similarity, spin_images

TAU = np.array([10.0, 10.0, 1.0, 1.0])  # Noise of x, y, x', y' [px, px a frame]; published
GEODESIC_SIGMA_M = 0.08  # Standard deviation of a geodesic distance to the reference [m]


class FeatureFilter(PointFilter):
    """Particles [x, y, x', y'] of one point in the image; its Kalman filter gives the velocity."""

    def __init__(
        self,
        name: str,
        config: DepthLayerConfig,
        generator: np.random.Generator,
    ) -> None:
        super().__init__(name)
        self._config, self._generator = config, generator
        self.particles: F64 = np.empty((0, 4))
        self.vertices = np.empty(0, np.int64)  # vertices of the particles; -1 off the body
        self.spin: F64 | None = None  # reference spin image

    def start_at_vertex(self, vertex: int, body: MeasuredBody) -> None:
        """Start all particles at a vertex, whose features are the reference."""
        super().start_at_vertex(vertex, body)
        self.particles = np.zeros((self._config.particles, 4))
        self.particles[:, :2] = body.mesh.pixels_px[vertex]
        self.vertices = np.full(self._config.particles, vertex)
        if self._config.feature == "spin":
            self.spin = spin_images(body.mesh, [vertex])[0]

    def move_particles(self, dt_s: float) -> None:
        """Move the particles by their motion with noise."""
        assert self.motion is not None
        self.motion.predict(dt_s)
        noise = TAU * self._generator.standard_normal(self.particles.shape)
        self.particles = self.particles @ FIRST.T + noise

    def update_particles(self, body: MeasuredBody, similarities: F64 | None, dt_s: float) -> None:
        """Weigh and resample particles; the one of maximum weight is the estimate, as published."""
        logs = feature_weights(self, body, similarities)
        best = int(np.argmax(logs))
        if not np.isfinite(logs[best]):
            self.particles[:, :2] = body.mesh.pixels_px[body.mesh.nearest(self.position_m)]
            self.particles[:, 2:] = 0.0
            self.mark_missed(dt_s)
            return
        weights = np.exp(logs - logs[best])
        position_m = body.mesh.points_m[self.vertices[best]]
        chosen = resample_systematic((weights / weights.sum())[None], self._generator)[0]
        self.particles = self.particles[chosen]
        self.mark_measured(position_m, 1.0, self.noise_m2(position_m))
        self.position_m = position_m

    def mark_missed(self, dt_s: float) -> None:
        """Keep the last position."""
        self.missed_s += dt_s
        if self.motion is not None:
            self.state, self.confidence = "predicted", 0.0


class SingleFeatureLayer(PointLayer[FeatureFilter]):
    """Tracks the points of one person by one feature."""

    def __init__(self, config: DepthLayerConfig, info: CameraInfo, seed: int = 0) -> None:
        generator = np.random.default_rng(seed)
        super().__init__(info, (FeatureFilter(name, config, generator) for name in POINTS))

    def update_points(self, observation: MeshObservation) -> Mapping[str, PointEstimate]:
        """Return the estimates of the points in the next frame."""
        body, dt_s = self._measure(observation), observation.dt_s
        points = [point for point in self._points.values() if point.motion is not None]
        if body is None:
            for point in points:
                assert point.motion is not None
                point.motion.predict(dt_s)
                point.mark_missed(dt_s)
            return self._estimates()
        for point in points:
            point.move_particles(dt_s)
            point.vertices = body.mesh.vertices_at(point.particles[:, :2])
        for point, similar in zip(points, spin_similarities(points, body.mesh), strict=True):
            point.update_particles(body, similar, dt_s)
        idle = [point for point in self._points.values() if point.motion is None]
        extremities = extremities_in_view(body, self._info) if idle else []
        for name, one in initial_extremities(
            self._points.values(), idle, extremities, body, self._meter.heading
        ):
            self._points[name].start_at_vertex(body.mesh.nearest(one.position_m), body)
        return self._estimates()

    def _measure(self, observation: MeshObservation) -> MeasuredBody | None:
        """Measure the body; geodesic distances begin at the top of the head, as published."""
        return self._meter.measure_body(observation, lambda _, heights_m: int(heights_m.argmax()))


def spin_similarities(points: Sequence[FeatureFilter], mesh: BodyMesh) -> list[F64 | None]:
    """Return the similarities of the particles' spin images to their points' references."""
    vertices = [point.vertices for point in points if point.spin is not None]
    if not vertices:
        return [None] * len(points)
    distinct = np.unique(np.concatenate([[-1], *vertices]))
    images = spin_images(mesh, distinct)
    found: list[F64 | None] = []
    for point in points:
        assert point.spin is not None
        rows, back = np.unique(point.vertices, return_inverse=True)
        own = images[np.searchsorted(distinct, rows)]
        found.append(similarity(own, point.spin)[back])
    return found


def feature_weights(point: FeatureFilter, body: MeasuredBody, similarities: F64 | None) -> F64:
    """Return the logarithms of particles' weights, N; -inf off the body.

    `similarities` (N) compare spin images; if None, geodesic distances are used.

    Source: docs/method.md, section 8.3 (G 4.2.3, 4.3).
    """
    if similarities is not None:
        logs = similarities / SIMILARITY_SIGMA
    else:
        geodesic_m = body.geodesic_m[np.maximum(point.vertices, 0)]
        off = np.abs(geodesic_m - point.geodesic_m) / GEODESIC_SIGMA_M
        logs = -0.5 * np.where(np.isfinite(off), off, 1e3) ** 2
    return np.where(point.vertices >= 0, np.nan_to_num(logs, nan=-np.inf), -np.inf)
