"""Likelihood of particles on a body.

Source: docs/method.md, sections 8.3 and 19.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from people4d.messages import F64
from services.gait.config import DepthLayerConfig
from services.gait.points.body import Extremity, MeasuredBody
from services.gait.points.keypoints import Anchor
from services.gait.points.limbs.surface import SurfacePosition
from services.gait.points.point_filter import PointFilter
from services.gait.surface.mesh import BodyMesh
from services.gait.surface.segmentation import I64
from services.gait.surface.spin_image import SIMILARITY_SIGMA, similarity, spin_images

GEODESIC_SIGMA_M = 0.08  # Standard deviation of a geodesic distance to the reference [m]
EXTREMITY_SIGMA_M = 0.04  # Standard deviation of a distance to the end of a limb [m]
CLIP = 8.0  # Maximum penalty by one feature, which alone excludes no particle
BODY_CLIP = 3.0  # Maximum penalty by the features of the body if there is a keypoint
KEYPOINT_RELIABLE = 0.6  # Minimum confidence of a keypoint on the right limb
WRONG_LIMB = 6.0  # Log-likelihood ratio of a particle on another kind of limb
PRIOR_FREE = 3.0  # Squared deviation from the body's prior without penalty


@dataclass(frozen=True)
class PointEvidence:
    """Evidence of one point in one frame, besides the body."""

    anchor: Anchor | None = None  # of its keypoint
    anchor_sigma_px: float = 1.0
    counterpart: PointFilter | None = None  # the same point on the other side of the body
    extremity: Extremity | None = None  # assigned to the point
    counterpart_extremity: Extremity | None = None  # assigned to the counterpart
    surface: SurfacePosition | None = None  # by the keypoint; without any, by the end of the limb


@dataclass(frozen=True)
class ParticleWeights:
    """Weights of particles."""

    logs: F64  # N, logarithms; -inf off the body
    trust: dict[str, float] = field(default_factory=dict)  # in each feature, 0 to 1


def agreement(deviation: F64) -> F64:
    """Return exp(-x^2 / 2), 0 to 1, of deviations in standard deviations."""
    return np.asarray(np.exp(-0.5 * np.minimum(np.abs(deviation), 9.0) ** 2))


def reference_spin_image(
    point: PointFilter, vertex: int, mesh: BodyMesh, config: DepthLayerConfig
) -> F64 | None:
    """Return the spin image that a point is tracked by; None if it is not tracked by one.

    Combined, only marked points that end no limb: limbs bend, and are tracked by distances; the
    torso is rigid.
    """
    if config.feature == "geodesic" or (config.feature == "combined" and point.kind):
        return None
    image: F64 = spin_images(mesh, [vertex])[0]
    return image


def spin_similarities(points: Sequence[PointFilter], mesh: BodyMesh) -> list[F64 | None]:
    """Return the similarities of the particles' spin images to their points' references."""
    vertices = [point.vertices for point in points if point.spin is not None]
    if not vertices:
        return [None] * len(points)
    distinct = np.unique(np.concatenate([[-1], *vertices]))
    images = spin_images(mesh, distinct)
    found: list[F64 | None] = []
    for point in points:
        if point.spin is None:
            found.append(None)
            continue
        rows, back = np.unique(point.vertices, return_inverse=True)
        own = images[np.searchsorted(distinct, rows)]
        found.append(similarity(own, point.spin)[back])
    return found


def single_feature_weights(
    point: PointFilter, body: MeasuredBody, similarities: F64 | None
) -> ParticleWeights:
    """Weigh particles by one feature: spin images, or without similarities (N) geodesic distances.

    Source: docs/method.md, section 8.3 (G 4.2.3, 4.3).
    """
    on_body = point.vertices >= 0
    if similarities is not None:
        logs = similarities / SIMILARITY_SIGMA
    else:
        logs = -0.5 * (_geodesic_deviation(point, body) ** 2)
    return ParticleWeights(np.where(on_body, np.nan_to_num(logs, nan=-np.inf), -np.inf))


def combined_weights(
    point: PointFilter,
    body: MeasuredBody,
    similarities: F64 | None,
    evidence: PointEvidence,
) -> ParticleWeights:
    """Weigh particles by all features, each by its own confidence.

    The geodesic distance is trusted as far as any particle agrees with the reference: a hand that
    touches the torso is nearer along the mesh. Spin images are trusted as far as any is similar to
    the reference. A keypoint identifies the limb; the body then decides near the keypoint only.

    Source: docs/method.md, section 19.
    """
    on_body = point.vertices >= 0
    vertices = np.where(on_body, point.vertices, 0)
    logs = np.where(on_body, 0.0, -np.inf)
    trust = {}
    off = _geodesic_deviation(point, body)
    trust["geodesic"] = float(agreement(off[on_body]).max(initial=0.0))
    logs -= trust["geodesic"] * np.minimum(0.5 * off**2, CLIP)
    if similarities is not None:
        best = float(np.where(on_body, similarities, -np.inf).max(initial=0.0))
        trust["spin"] = min(best / 2.0, 1.0)
        off = (best - np.maximum(similarities, -2.0)) / SIMILARITY_SIGMA
        logs -= trust["spin"] * np.minimum(off, CLIP)
    logs -= _limb_penalty(point, body, vertices, evidence)
    if point.prior is not None:
        squares = point.prior.distances2(body.mesh.points_m[vertices])
        logs -= np.clip(0.5 * (squares - PRIOR_FREE), 0.0, CLIP)
    if evidence.anchor is not None:
        logs = np.where(on_body, np.maximum(logs - logs.max(initial=-1e3), -BODY_CLIP), -np.inf)
    points_m = body.mesh.points_m[vertices]
    if point.alive and point.motion is not None:
        logs += _motion_log(point, points_m)
        logs += _counterpart_log(point, points_m, evidence.counterpart)
    if evidence.anchor is not None:
        offsets = np.linalg.norm(point.particles[:, :2] - evidence.anchor.pixel, axis=1)
        reliable = 0.98 * min(evidence.anchor.confidence / KEYPOINT_RELIABLE, 1.0)
        near = agreement(offsets / evidence.anchor_sigma_px)
        logs += np.log(reliable * near + (1 - reliable) * 0.05 + 1e-3)
    return ParticleWeights(logs, trust)


def _geodesic_deviation(point: PointFilter, body: MeasuredBody) -> F64:
    """Return the deviation of particles' geodesic distance from the reference, in sigmas."""
    geodesic = body.geodesic_m[np.maximum(point.vertices, 0)]
    off = np.abs(geodesic - point.geodesic_m) / GEODESIC_SIGMA_M
    return np.asarray(np.where(np.isfinite(off), off, 1e3))


def _limb_penalty(
    point: PointFilter,
    body: MeasuredBody,
    vertices: I64,
    evidence: PointEvidence,
) -> F64:
    """Return the penalty of particles by their limb and their distance to its end."""
    if not np.isfinite(point.tip_distance_m):
        return np.zeros(len(vertices))
    basin = body.extrema.basin[vertices]
    strengths = np.append(body.extrema.strengths, 0.0)[basin]
    off = (body.tip_distance_m[vertices] - point.tip_distance_m) / EXTREMITY_SIGMA_M
    along = strengths * np.minimum(0.5 * np.nan_to_num(off, posinf=1e3) ** 2, CLIP)
    same = np.array([*(kind in (point.kind, "") for kind in body.kinds), True])[basin]
    if evidence.extremity is not None:
        own = basin == evidence.extremity.basin
    else:
        other = evidence.counterpart_extremity
        own = same & (basin != (other.basin if other else -2))
    wrong = 0.5 * WRONG_LIMB * (1.0 + strengths)
    unassigned = np.where(own & (evidence.extremity is None), 1.0, 0.0)
    return np.asarray(np.where(own, along + unassigned, wrong))


def _motion_log(point: PointFilter, points_m: F64) -> F64:
    """Return log-likelihoods by the prediction, of heavy tails."""
    assert point.motion is not None
    squares = point.motion.distances2(points_m, point.noise_m2(point.motion.position_m))
    return np.asarray(-2.0 * np.log1p(squares / 4.0))


def _counterpart_log(point: PointFilter, points_m: F64, other: PointFilter | None) -> F64:
    """Return log-probabilities that particles are this point rather than its counterpart."""
    if other is None or other.motion is None or not other.alive or point.motion is None:
        return np.zeros(len(points_m))
    own = point.motion.distances2(points_m, point.noise_m2(point.motion.position_m))
    their = other.motion.distances2(points_m, other.noise_m2(other.motion.position_m))
    return np.asarray(-np.log1p(np.exp(np.clip((own - their) / 2, -30, CLIP))))
