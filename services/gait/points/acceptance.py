"""Acceptance of measured positions that lie on the point itself.

Source: docs/method.md, section 19.
"""

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from common.geometry.transforms import deproject, project
from people4d.messages import F64, CameraInfo
from services.gait.points.body import MeasuredBody
from services.gait.points.keypoints import START_CONFIDENCE, Anchor, sigma_px
from services.gait.points.limbs.surface import SurfacePosition
from services.gait.points.limbs.visibility import (
    VISIBILITY,
    WITHOUT_KEYPOINTS,
    PointEvidence,
    Visibility,
    limb_evidence,
    shank_points_away,
)
from services.gait.points.point_filter import GATE, TIMEOUT_S, PointFilter

CONFIDENCE_MIN = 0.25  # Minimum confidence of a measured position
TOLERANCE = 1.5  # Unit of deviations [standard deviations]
GEODESIC_SIGMA_M = 0.08  # Standard deviation of a geodesic distance to the reference [m]
# Minimum distance of an occluding surface before the expected position [m, standard deviations]
OCCLUDED_M, OCCLUDED_SIGMAS = 0.07, 2.0
PIXEL_SIGMA = 3.0  # Standard deviation of a point on the surface [px]
HIDDEN_M = 0.5  # Standard deviation of the depth of a hidden point [m]


@dataclass(frozen=True)
class SurfaceUncertainty:
    """Standard deviations [m] of measurements on a possibly different surface."""

    before: float  # distance of a hidden point from the surface in front of it
    depth: float  # depth of a visible point
    across: float  # position of a keypoint in the image


# Legs are closer to each other than an arm to the torso.
UNCERTAINTIES = MappingProxyType(
    {
        "foot": SurfaceUncertainty(0.12, 0.04, 0.03),
        "hand": SurfaceUncertainty(0.28, 0.05, 0.05),
    }
)


class Acceptance:
    """Updates points by their measured positions if the evidence is sufficient."""

    def __init__(self, info: CameraInfo) -> None:
        self._info = info
        self.has_keypoints = False  # True if any point has a keypoint in this frame
        self.trusts_keypoints = False  # True if the keypoints of this person are trusted

    def is_hidden(self, point: PointFilter, position_m: F64, anchor: Anchor | None) -> bool:
        """Check for a surface in front of the expected position of a point, on its ray."""
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

    def update_point(
        self, point: PointFilter, body: MeasuredBody, evidence: PointEvidence, dt_s: float
    ) -> None:
        """Update a point by its measured position; if None, the point is hidden."""
        surface = evidence.surface
        if surface is None:
            point.mark_missed(dt_s)
            return
        odds = self._odds(point, body, evidence)
        if self._is_covered(point, body, surface, evidence, odds):
            point.unsupported_s += dt_s
            if point.kind == "head" or point.state == "lost":
                point.mark_missed(dt_s)
            else:
                noise_m2 = _uncertainty_m2(point, surface, None)
                point.mark_doubtful(surface.position_m, noise_m2, dt_s, likely=False)
        else:
            self._accept(point, body, surface, evidence, odds, dt_s)

    def _is_covered(
        self,
        point: PointFilter,
        body: MeasuredBody,
        surface: SurfacePosition,
        evidence: PointEvidence,
        odds: float | None,
    ) -> bool:
        """Check for a surface that hides a point or its joint, unless all other evidence disagrees.

        A limb with fast or unexpected motion is also in front of its expected position.
        """
        anchor = evidence.anchor
        hidden = self.is_hidden(point, surface.position_m, anchor)
        if not hidden and anchor is not None and anchor.joint is not None:
            joint_m = float(body.mesh.points_m[surface.vertex, 2])
            hidden = self.is_hidden(point, deproject(anchor.joint, joint_m, self._info)[0], anchor)
        return hidden and (anchor is None or odds is None or odds <= 0)

    def _accept(
        self,
        point: PointFilter,
        body: MeasuredBody,
        surface: SurfacePosition,
        evidence: PointEvidence,
        odds: float | None,
        dt_s: float,
    ) -> None:
        assert point.motion is not None
        position_m = surface.position_m
        noise_m2 = point.noise_m2(position_m, surface.noise_m2)
        off = float(np.sqrt(point.motion.distances2(position_m[None], noise_m2)[0]))
        confidence = self._support(point, body, surface, evidence, dt_s)
        confidence *= _agreement(off / GATE * TOLERANCE**2)
        supported = confidence >= CONFIDENCE_MIN
        if off > GATE or point.state == "lost" or (surface.by_distance and not supported):
            point.mark_missed(dt_s)
        elif supported and self._is_visible(point, body, evidence.anchor, odds):
            point.mark_measured(position_m, confidence, noise_m2)
            if confidence > START_CONFIDENCE:
                point.adapt_reference(float(body.geodesic_m[surface.vertex]))
        else:
            noise_m2 = _uncertainty_m2(point, surface, odds)
            likely = odds is not None and odds > 0
            point.mark_doubtful(position_m, noise_m2, dt_s, likely=likely)

    def _support(
        self,
        point: PointFilter,
        body: MeasuredBody,
        surface: SurfacePosition,
        evidence: PointEvidence,
        dt_s: float,
    ) -> float:
        """Return the confidence in a position by the end of its limb, keypoint and distance."""
        extremity, anchor, support = evidence.extremity, evidence.anchor, 0.0
        if extremity is not None and body.extrema.basin[surface.vertex] == extremity.basin:
            support = extremity.strength
        if anchor is not None:
            pixel = project(surface.position_m, self._info)[0]
            noise_px = sigma_px(anchor, float(surface.position_m[2]), self._info)
            off = float(np.linalg.norm(pixel - anchor.pixel)) / noise_px
            reliable = float(np.clip((anchor.confidence - 0.4) / 0.3, 0.0, 1.0))
            support = max(support, reliable * _agreement(off))
        point.unsupported_s = 0.0 if support > CONFIDENCE_MIN else point.unsupported_s + dt_s
        if self.has_keypoints:
            return support
        # A similar distance along the body at another position counts for a short time only.
        decay = float(np.exp(-point.unsupported_s / (2 * TIMEOUT_S)))
        off_m = float(body.geodesic_m[surface.vertex] - point.geodesic_m)
        return max(support, decay * _agreement(off_m / GEODESIC_SIGMA_M))

    def _visibility(self, point: PointFilter) -> Visibility | None:
        """Return the regression of a point's visibility; None for heads.

        If keypoints are used, there is no regression for a frame without a detection.
        """
        if self.has_keypoints:
            return VISIBILITY.get(point.kind)
        return None if self.trusts_keypoints else WITHOUT_KEYPOINTS.get(point.kind)

    def _odds(
        self, point: PointFilter, body: MeasuredBody, evidence: PointEvidence
    ) -> float | None:
        """Return the log-odds that the point is on the measured surface; None if unknown."""
        kind = self._visibility(point)
        measured = limb_evidence(point, body, evidence, self._info) if kind else None
        return None if kind is None or measured is None else kind.odds(measured)

    def _is_visible(
        self, point: PointFilter, body: MeasuredBody, anchor: Anchor | None, odds: float | None
    ) -> bool:
        """Check that the measured surface probably belongs to the point itself.

        If keypoints are used, this requires a detection and a heading.
        """
        kind = self._visibility(point)
        if odds is None or kind is None:
            return point.kind == "head" or not self.trusts_keypoints
        if point.kind == "foot" and shank_points_away(anchor, body, self._info):
            return False
        return odds >= kind.least


def _uncertainty_m2(point: PointFilter, surface: SurfacePosition, odds: float | None) -> F64:
    """Return the covariance of a position, 3x3, by the log-odds of its surface; None: hidden."""
    uncertainty = UNCERTAINTIES["foot" if point.kind == "foot" else "hand"]
    hidden = 1.0 if odds is None else 1.0 / (1.0 + float(np.exp(odds)))
    across_m = uncertainty.before / 2 if surface.by_distance else uncertainty.across
    ray = surface.position_m / np.linalg.norm(surface.position_m)
    along_m2 = uncertainty.depth**2 + hidden * uncertainty.before**2
    along_m2 = HIDDEN_M**2 if odds is None else along_m2
    return np.asarray(across_m**2 * np.eye(3) + along_m2 * np.outer(ray, ray))


def _agreement(off: float) -> float:
    """Return exp(-x² / 2), 0 to 1, of a deviation x in units of TOLERANCE; 0 if not finite."""
    x = min(abs(off / TOLERANCE), 9.0) if np.isfinite(off) else 9.0
    return float(np.exp(-0.5 * x**2))
