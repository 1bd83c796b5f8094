"""Acceptance of a measured position: whether it lies on the point itself.

Source: docs/method.md, section 19.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from common.geometry.transforms import deproject, project
from people4d.messages import F64, CameraInfo
from services.gait.config import DepthLayerConfig
from services.gait.points.body import WINDOW_M, MeasuredBody
from services.gait.points.keypoints import PAIRS, START_CONFIDENCE, Anchor
from services.gait.points.likelihood import (
    EXTREMITY_SIGMA_M,
    GEODESIC_SIGMA_M,
    PRIOR_FREE,
    ParticleWeights,
    PointEvidence,
    agreement,
)
from services.gait.points.limbs.anchors import SAME_M
from services.gait.points.limbs.surface import SurfacePosition
from services.gait.points.limbs.visibility import (
    VISIBILITY,
    WITHOUT_KEYPOINTS,
    Visibility,
    limb_evidence,
    shank_points_away,
)
from services.gait.points.point_filter import GATE, TIMEOUT_S, PointFilter

CONFIDENCE_MIN = 0.25  # Minimum confidence of a measured position
CONTRADICTION = 3.0  # Deviation of a point from a contradicting keypoint [standard deviations]
TOLERANCE = 1.5  # Unit of deviations [standard deviations]
# Minimum distance of an occluding surface before the expected position [m, standard deviations]
OCCLUDED_M, OCCLUDED_SIGMAS = 0.07, 2.0
PIXEL_SIGMA = 3.0  # Standard deviation of a point on the surface [px]
HIDDEN_M = 0.5  # Standard deviation of the depth of a hidden point [m]


@dataclass(frozen=True)
class SurfaceUncertainty:
    """Standard deviations [m] of a measurement that may be on another surface."""

    before: float  # between a hidden point and the surface before it
    depth: float  # of a visible point
    across: float  # of a keypoint, in the image


# Legs are nearer to each other than an arm to the torso.
UNCERTAINTIES = MappingProxyType(
    {
        "foot": SurfaceUncertainty(0.12, 0.04, 0.03),
        "hand": SurfaceUncertainty(0.28, 0.05, 0.05),
    }
)


@dataclass(frozen=True)
class Candidate:
    """Position that a point measures, by its keypoint or by its particles."""

    position_m: F64  # 3, optical frame
    vertex: int  # at the keypoint, or of the best particle
    noise_m2: F64 | None = None  # 3x3, without the noise of depth; None: noise of particles


class Acceptance:
    """Updates points by their weighted particles if the evidence is sufficient."""

    def __init__(self, config: DepthLayerConfig, info: CameraInfo) -> None:
        self._config, self._info = config, info
        self.has_keypoints = False  # in this frame, of any point
        self.had_keypoints = False  # in any frame

    def measure_candidate(
        self,
        point: PointFilter,
        body: MeasuredBody,
        weighted: ParticleWeights,
        surface: SurfacePosition | None,
    ) -> Candidate | None:
        """Return the position that a point measures, and resample its particles.

        The surface behind a keypoint is more precise than particles.
        """
        logs = weighted.logs
        best = int(np.argmax(logs))
        if not np.isfinite(logs[best]):
            point.reset_particles(body)
            return _at(surface)
        weights = np.exp(logs - logs[best])
        weights /= weights.sum()
        positions = body.mesh.points_m[np.maximum(point.vertices, 0)]
        vertex, position = int(point.vertices[best]), positions[best]
        if self._config.feature == "combined":
            near = np.linalg.norm(positions - positions[best], axis=1) <= WINDOW_M
            inside = weights * near * (point.vertices >= 0)
            position = (inside / inside.sum()) @ positions
        point.resample_particles(weights)
        return _at(surface) or Candidate(position, vertex)

    def is_hidden(self, point: PointFilter, position_m: F64, anchor: Anchor | None) -> bool:
        """Check that a surface lies before the expected position of a point on its ray."""
        expected = point.expected_position()
        if point.prior is None or expected is None:
            return False
        reliable = 0.0 if anchor is None else (anchor.confidence - 0.4) / 0.2
        sigmas = float(np.clip(1.0 + reliable, 1.0, OCCLUDED_SIGMAS))
        expectations = [(expected, OCCLUDED_SIGMAS)]
        if not point.follows_limb:
            expectations.append((point.prior, sigmas))
        for one, times in expectations:
            there, _ = one.on_ray(position_m, PIXEL_SIGMA, self._info)
            limit_m = OCCLUDED_M + times * float(np.sqrt(there.covariance[2, 2]))
            if there.mean_m[2] - position_m[2] > limit_m:
                return True
        return False

    def _is_covered(
        self, point: PointFilter, body: MeasuredBody, candidate: Candidate, evidence: PointEvidence
    ) -> bool:
        """Check that a surface hides a point or its joint, unless a keypoint and all else disagree.

        A limb that moves fast, or otherwise than expected, is before its expected position, too.
        """
        hidden = self.is_hidden(point, candidate.position_m, evidence.anchor)
        if not (hidden or self._joint_is_hidden(point, body, evidence)):
            return False
        odds = self._odds(point, body, candidate, evidence) if evidence.anchor else None
        return odds is None or odds <= 0

    def _joint_is_hidden(
        self, point: PointFilter, body: MeasuredBody, evidence: PointEvidence
    ) -> bool:
        """Check that the body's surface hides the wrist or ankle of a point."""
        anchor, surface = evidence.anchor, evidence.surface
        if anchor is None or anchor.joint is None or surface is None:
            return False
        surface_m = float(body.mesh.points_m[surface.vertex, 2])
        joint_m = deproject(anchor.joint, surface_m, self._info)[0]
        return self.is_hidden(point, joint_m, anchor)

    def update_point(
        self,
        point: PointFilter,
        body: MeasuredBody,
        candidate: Candidate | None,
        evidence: PointEvidence,
        dt_s: float,
    ) -> None:
        """Update a point by its candidate; None: it is hidden."""
        point.hidden_keypoint = evidence.anchor
        if candidate is None:
            point.mark_missed(dt_s)
        elif self._config.feature != "combined":
            point.mark_measured(candidate.position_m, 1.0)
        elif self._is_covered(point, body, candidate, evidence):
            point.unsupported_s += dt_s
            if candidate.noise_m2 is None or point.state == "lost":
                point.mark_missed(dt_s)
            else:
                noise_m2 = _uncertainty_m2(point, candidate, None)
                point.mark_doubtful(candidate.position_m, noise_m2, dt_s, likely=False)
        else:
            self._accept(point, body, candidate, evidence, dt_s)

    def _accept(
        self,
        point: PointFilter,
        body: MeasuredBody,
        candidate: Candidate,
        evidence: PointEvidence,
        dt_s: float,
    ) -> None:
        assert point.motion is not None
        position, vertex = candidate.position_m, candidate.vertex
        noise = point.noise_m2(position, candidate.noise_m2)
        off = float(np.sqrt(point.motion.distances2(position[None], noise)[0]))
        support = max(
            self._by_extremity(point, body, vertex, evidence),
            self._by_anchor(point, position, evidence),
        )
        point.unsupported_s = 0.0 if support > CONFIDENCE_MIN else point.unsupported_s + dt_s
        # Without extremity and keypoint, similar features elsewhere count for a short time only.
        decay = float(np.exp(-point.unsupported_s / (2 * TIMEOUT_S))) if point.kind else 1.0
        if not (self.has_keypoints and point.prior is not None):
            support = max(support, decay * self._by_distance(point, body, vertex))
        elif evidence.anchor is None and point.prior is not None:
            squares = float(point.prior.distances2(position[None])[0])
            support *= _agreement(np.sqrt(max(squares - PRIOR_FREE, 0.0)))
        confidence = support * _agreement(off / GATE * TOLERANCE**2)
        supported = confidence >= CONFIDENCE_MIN
        if off > GATE or point.state == "lost" or not (supported or candidate.noise_m2 is not None):
            point.mark_missed(dt_s)
            return
        odds = self._odds(point, body, candidate, evidence)
        if not (supported and self._is_visible(point, body, evidence.anchor, odds)):
            noise_m2 = _uncertainty_m2(point, candidate, odds)
            point.mark_doubtful(position, noise_m2, dt_s, likely=odds is not None and odds > 0)
            return
        point.mark_measured(position, confidence, noise)
        if confidence > START_CONFIDENCE:
            point.adapt_reference(float(body.geodesic_m[vertex]))

    def _visibility(self, point: PointFilter) -> Visibility | None:
        """Return the regression of a point's visibility; None for heads and marked points.

        If keypoints are used, there is no regression for a frame without a detection.
        """
        if self.has_keypoints:
            return VISIBILITY.get(point.kind)
        return None if self.had_keypoints else WITHOUT_KEYPOINTS.get(point.kind)

    def _odds(
        self,
        point: PointFilter,
        body: MeasuredBody,
        candidate: Candidate,
        evidence: PointEvidence,
    ) -> float | None:
        """Return the log-odds that the point is on the measured surface; None: not known."""
        kind = self._visibility(point)
        if kind is None:
            return None
        measured = limb_evidence(
            point,
            candidate.position_m,
            candidate.vertex,
            body,
            evidence.anchor,
            evidence.counterpart,
            evidence.extremity,
            self._info,
        )
        return None if measured is None else kind.odds(measured)

    def _is_visible(
        self, point: PointFilter, body: MeasuredBody, anchor: Anchor | None, odds: float | None
    ) -> bool:
        """Check that the measured surface probably belongs to the point itself.

        With keypoints this is not known without a detection or a heading.
        """
        kind = self._visibility(point)
        if odds is None or kind is None:
            return point.kind not in VISIBILITY or not self.had_keypoints
        if point.kind == "foot" and shank_points_away(anchor, body, self._info):
            return False
        return odds >= kind.least

    def _by_extremity(
        self, point: PointFilter, body: MeasuredBody, vertex: int, evidence: PointEvidence
    ) -> float:
        extremity = evidence.extremity
        if extremity is None or body.extrema.basin[vertex] != extremity.basin:
            return 0.0
        if not np.isfinite(point.tip_distance_m):
            return 0.0
        off = float(body.tip_distance_m[vertex] - point.tip_distance_m)
        return extremity.strength * _agreement(off / EXTREMITY_SIGMA_M)

    def _by_distance(self, point: PointFilter, body: MeasuredBody, vertex: int) -> float:
        off = float(body.geodesic_m[vertex] - point.geodesic_m) / GEODESIC_SIGMA_M
        return _agreement(off) if np.isfinite(off) else 0.0

    def _by_anchor(self, point: PointFilter, position: F64, evidence: PointEvidence) -> float:
        anchor = evidence.anchor
        if anchor is None:
            return 0.0
        pixel = project(position, self._info)[0]
        off = float(np.linalg.norm(pixel - anchor.pixel)) / evidence.anchor_sigma_px
        contradicts = off > CONTRADICTION and anchor.confidence > START_CONFIDENCE
        point.contradicted = point.contradicted + 1 if contradicts else 0
        return float(np.clip((anchor.confidence - 0.4) / 0.3, 0.0, 1.0)) * _agreement(off)


def _uncertainty_m2(point: PointFilter, candidate: Candidate, odds: float | None) -> F64:
    """Return the covariance of a position, 3x3, by the log-odds of its surface; None: hidden.

    Its keypoint is right in the image.
    """
    uncertainty = UNCERTAINTIES.get(point.kind, UNCERTAINTIES["hand"])
    hidden = 1.0 if odds is None else 1.0 / (1.0 + float(np.exp(odds)))
    across_m = uncertainty.across if candidate.noise_m2 is not None else uncertainty.before / 2
    ray = candidate.position_m / np.linalg.norm(candidate.position_m)
    along_m2 = uncertainty.depth**2 + hidden * uncertainty.before**2
    along_m2 = HIDDEN_M**2 if odds is None else along_m2
    return np.asarray(across_m**2 * np.eye(3) + along_m2 * np.outer(ray, ray))


def drop_same(candidates: dict[str, Candidate | None], points: Mapping[str, PointFilter]) -> None:
    """Drop one of two candidates on one limb: the one farther from its expected position."""
    for pair in PAIRS:
        both = [(name, one) for name in pair if (one := candidates.get(name)) is not None]
        if len(both) < 2:
            continue
        (_, first), (_, second) = both
        if np.linalg.norm(first.position_m - second.position_m) > SAME_M:
            continue
        off = [_off2(points[name], one.position_m) for name, one in both]
        candidates[pair[int(np.argmax(off))]] = None


def _off2(point: PointFilter, position_m: F64) -> float:
    expected = point.expected_position()
    return 0.0 if expected is None else float(expected.distances2(position_m[None])[0])


def _at(surface: SurfacePosition | None) -> Candidate | None:
    if surface is None:
        return None
    return Candidate(surface.position_m, surface.vertex, surface.noise_m2)


def _agreement(off: float) -> float:
    return float(agreement(np.array(off / TOLERANCE)))
