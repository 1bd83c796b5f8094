"""How particles are weighed: each feature alone, as in the paper, or all together."""

from dataclasses import dataclass, field

import numpy as np

from people4d.messages import F64
from services.gait.points.config import DepthLayerConfig
from services.gait.points.limbs import Body3d, LimbEnd
from services.gait.points.point_filter import PointFilter
from services.gait.points.points import Anchor
from services.gait.surface.mesh import I64

CLIP = 8.0  # no feature alone rules a particle out
BODY_CLIP = 3.0  # what the body tells together, where a keypoint tells which limb it is
BELIEVED = 0.6  # confidence of a keypoint from which on it is hardly ever on the wrong limb
WRONG_LIMB = 6.0  # logarithm of how much less a particle on another kind of limb weighs


@dataclass(frozen=True)
class Hints:
    """What speaks for a point besides its own past."""

    anchor: Anchor | None = None  # of its keypoint
    anchor_sigma_px: float = 1.0
    other: PointFilter | None = None  # the same on the other side of the body
    end: LimbEnd | None = None  # of the point's limb
    taken: LimbEnd | None = None  # of the limb on the other side


@dataclass(frozen=True)
class Weighed:
    """Particles' weights."""

    logs: F64  # N, logarithms; -inf off the body
    trust: dict[str, float] = field(default_factory=dict)  # in each feature, 0 to 1


def agreement(away: F64) -> F64:
    """Return exp(-x^2 / 2), 0 to 1, of departures in standard deviations."""
    return np.asarray(np.exp(-0.5 * np.minimum(np.abs(away), 9.0) ** 2))


def alone(
    point: PointFilter,
    body: Body3d,
    alike: F64 | None,
    _hints: Hints,
    config: DepthLayerConfig,
) -> Weighed:
    """Weigh particles by one feature.

    Args:
        point: With particles on the body.
        body: Its surface.
        alike: N, similarity of spin images to the reference; None: distances are compared.
        config: Which feature, and its noise.

    Source: method book section 8.3 [G 4.2.3, 4.3].
    """
    on = point.vertices >= 0
    if alike is not None:
        logs = alike / config.spin_sigma
    else:
        logs = -0.5 * (_off_along(point, body, config) ** 2)
    return Weighed(np.where(on, np.nan_to_num(logs, nan=-np.inf), -np.inf))


def together(
    point: PointFilter, body: Body3d, alike: F64 | None, hints: Hints, config: DepthLayerConfig
) -> Weighed:
    """Weigh particles by all there is, each feature trusted by its own confidence.

    Distance along the body is trusted as far as any particle agrees with the one at the start: a
    hand that touches the trunk is nearer along the mesh, and then it tells nothing. Spin images are
    trusted as far as any is like the reference. Keypoints tell which limb is which; the body then
    tells only what of it is near the keypoint.
    """
    on = point.vertices >= 0
    at = np.where(on, point.vertices, 0)
    logs = np.where(on, 0.0, -np.inf)
    trust = {}
    off = _off_along(point, body, config)
    trust["geodesic"] = float(agreement(off[on]).max(initial=0.0))
    logs -= trust["geodesic"] * np.minimum(0.5 * off**2, CLIP)
    if alike is not None:
        best = float(np.where(on, alike, -np.inf).max(initial=0.0))
        trust["spin"] = min(best / 2.0, 1.0)
        off = (best - np.maximum(alike, -2.0)) / config.spin_sigma
        logs -= trust["spin"] * np.minimum(off, CLIP)
    logs -= _off_limb(point, body, at, hints, config)
    if hints.anchor is not None:
        logs = np.where(on, np.maximum(logs - logs.max(initial=-1e3), -BODY_CLIP), -np.inf)
    points_m = body.surface.points_m[at]
    if point.alive and point.motion is not None:
        logs += _by_motion(point, points_m)
        logs += _by_other(point, points_m, hints.other)
    if hints.anchor is not None:
        away = np.linalg.norm(point.particles[:, :2] - hints.anchor.pixel, axis=1)
        sure = 0.98 * min(hints.anchor.confidence / BELIEVED, 1.0)
        near = agreement(away / hints.anchor_sigma_px)
        logs += np.log(sure * near + (1 - sure) * 0.05 + 1e-3)
    return Weighed(logs, trust)


def _off_along(point: PointFilter, body: Body3d, config: DepthLayerConfig) -> F64:
    """Return how far particles' distance along the body departs from the reference, in sigmas."""
    along = body.along_m[np.maximum(point.vertices, 0)]
    off = np.abs(along - point.along_m) / config.geodesic_sigma_m
    return np.asarray(np.where(np.isfinite(off), off, 1e3))


def _off_limb(
    point: PointFilter, body: Body3d, at: I64, hints: Hints, config: DepthLayerConfig
) -> F64:
    """Return what speaks against particles by the limb that they are on, and by where on it."""
    if not np.isfinite(point.below_m):
        return np.zeros(len(at))
    basin = body.tips.basin[at]
    strengths = np.append(body.strengths, 0.0)[basin]
    off = (body.below_m[at] - point.below_m) / config.tip_sigma_m
    along = strengths * np.minimum(0.5 * np.nan_to_num(off, posinf=1e3) ** 2, CLIP)
    same = np.array([*(kind in (point.kind, "") for kind in body.kinds), True])[basin]
    if hints.end is not None:
        own = basin == hints.end.basin
    else:
        own = same & (basin != (hints.taken.basin if hints.taken else -2))
    wrong = 0.5 * WRONG_LIMB * (1.0 + strengths)
    nearly = np.where(own & (hints.end is None), 1.0, 0.0)
    return np.asarray(np.where(own, along + nearly, wrong))


def _by_motion(point: PointFilter, points_m: F64) -> F64:
    """Return how well particles fit the motion; those far off are unlikely, not impossible."""
    assert point.motion is not None
    squares = point.motion.distances2(points_m, point.noise_m2(point.motion.position_m))
    return np.asarray(-2.0 * np.log1p(squares / 4.0))


def _by_other(point: PointFilter, points_m: F64, other: PointFilter | None) -> F64:
    """Return how much likelier than the other hand's or foot's particles are this one's."""
    if other is None or other.motion is None or not other.alive or point.motion is None:
        return np.zeros(len(points_m))
    own = point.motion.distances2(points_m, point.noise_m2(point.motion.position_m))
    their = other.motion.distances2(points_m, other.noise_m2(other.motion.position_m))
    return np.asarray(-np.log1p(np.exp(np.clip((own - their) / 2, -30, CLIP))))
