"""Acceptance of the position that a point's particles measure (docs/method.md, section 19)."""

import numpy as np

from common.geometry.transforms import project
from people4d.messages import F64, CameraInfo
from services.gait.config import DepthLayerConfig
from services.gait.points.body import MeasuredBody
from services.gait.points.keypoints import START_CONFIDENCE
from services.gait.points.likelihood import ParticleWeights, PointEvidence, agreement
from services.gait.points.point_filter import PointFilter

CONTRADICTION = 3.0  # [standard deviations] of a point from its keypoint
TOLERANCE = 1.5  # [standard deviations] that count as one


class Acceptance:
    """Updates points by their weighted particles, where the evidence is sufficient."""

    def __init__(self, config: DepthLayerConfig, info: CameraInfo) -> None:
        self._config, self._info = config, info

    def update(
        self,
        point: PointFilter,
        body: MeasuredBody,
        weighted: ParticleWeights,
        evidence: PointEvidence,
        dt_s: float,
    ) -> None:
        """Update a point, and resample its particles."""
        logs = weighted.logs
        best = int(np.argmax(logs))
        if not np.isfinite(logs[best]):
            point.mark_missed(dt_s)
            point.reset_particles(body)
            return
        weights = np.exp(logs - logs[best])
        weights /= weights.sum()
        positions = body.mesh.points_m[np.maximum(point.vertices, 0)]
        if self._config.feature == "combined":
            near = np.linalg.norm(positions - positions[best], axis=1) <= self._config.window_m
            inside = weights * near * (point.vertices >= 0)
            position = (inside / inside.sum()) @ positions
            self._accept(point, body, position, int(point.vertices[best]), evidence, dt_s)
        else:
            point.mark_measured(positions[best], 1.0)
        point.resample(weights)

    def _accept(
        self,
        point: PointFilter,
        body: MeasuredBody,
        position: F64,
        vertex: int,
        evidence: PointEvidence,
        dt_s: float,
    ) -> None:
        assert point.motion is not None
        config = self._config
        noise = point.noise_m2(position)
        off = float(np.sqrt(point.motion.distances2(position[None], noise)[0]))
        support = max(
            self._by_extremity(point, body, vertex, evidence),
            self._by_anchor(point, position, evidence),
        )
        point.unsupported_s = 0.0 if support > config.confidence_min else point.unsupported_s + dt_s
        # Without extremity and keypoint, similar features elsewhere count for a while only.
        decay = float(np.exp(-point.unsupported_s / (2 * config.timeout_s))) if point.kind else 1.0
        support = max(support, decay * self._by_distance(point, body, vertex))
        confidence = support * _agreement(off / config.gate * TOLERANCE**2)
        if off > config.gate or confidence < config.confidence_min or point.state == "lost":
            point.mark_missed(dt_s)
            return
        point.mark_measured(position, confidence)
        if confidence > START_CONFIDENCE:
            point.adapt(float(body.geodesic_m[vertex]))

    def _by_extremity(
        self, point: PointFilter, body: MeasuredBody, vertex: int, evidence: PointEvidence
    ) -> float:
        """Return the agreement of a vertex with the point's extremity, 0 to 1."""
        extremity = evidence.extremity
        if extremity is None or body.extrema.basin[vertex] != extremity.basin:
            return 0.0
        if not np.isfinite(point.tip_distance_m):
            return 0.0
        off = float(body.tip_distance_m[vertex] - point.tip_distance_m)
        return extremity.strength * _agreement(off / self._config.extremity_sigma_m)

    def _by_distance(self, point: PointFilter, body: MeasuredBody, vertex: int) -> float:
        """Return the agreement of a vertex with the reference distance, 0 to 1."""
        off = float(body.geodesic_m[vertex] - point.geodesic_m) / self._config.geodesic_sigma_m
        return _agreement(off) if np.isfinite(off) else 0.0

    def _by_anchor(self, point: PointFilter, position: F64, evidence: PointEvidence) -> float:
        """Return the agreement of a position with the point's keypoint, 0 to 1."""
        anchor = evidence.anchor
        if anchor is None:
            return 0.0
        pixel = project(position, self._info)[0]
        off = float(np.linalg.norm(pixel - anchor.pixel)) / evidence.anchor_sigma_px
        contradicts = off > CONTRADICTION and anchor.confidence > START_CONFIDENCE
        point.contradicted = point.contradicted + 1 if contradicts else 0
        return float(np.clip((anchor.confidence - 0.4) / 0.3, 0.0, 1.0)) * _agreement(off)


def _agreement(off: float) -> float:
    return float(agreement(np.array(off / TOLERANCE)))
