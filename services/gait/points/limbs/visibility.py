"""Visibility of hands and feet: probability that the measured surface belongs to the point.

The surface on the ray of a hidden point belongs to the torso, the other limb or another person. A
logistic regression on keypoint, expected position, other limb and distance along the body gives the
log-odds that the point is visible.

Source: docs/method.md, section 19.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from common.geometry.transforms import project
from people4d.messages import CameraInfo
from services.gait.points.body import Extremity, MeasuredBody
from services.gait.points.keypoints import Anchor
from services.gait.points.limbs.surface import SurfacePosition
from services.gait.points.point_filter import PointFilter

PIXEL_SIGMA = 3.0  # Standard deviation of a point on the surface [px]
SHANK = 0.246  # Length from knee to ankle [statures] [Winter 2009]
# Shank that points away from the camera: maximum share of its length in the image, and minimum
# depth of the surface at the ankle behind the surface at the knee [m]
AWAY_SHARE, AWAY_M = 0.5, 0.1
SIGMAS_MAX = 20.0**0.5  # Limit of a deviation [standard deviations]
DISTINCT_END = 0.7  # Minimum strength of the end of a limb that may have any pose


@dataclass(frozen=True)
class PointEvidence:
    """Evidence of one point in one frame, in addition to the body."""

    anchor: Anchor | None = None  # anchor of its keypoint
    counterpart: PointFilter | None = None  # the same point on the other side of the body
    extremity: Extremity | None = None  # extremity assigned to the point
    surface: SurfacePosition | None = None  # measured position


class LimbEvidence(NamedTuple):
    """Evidence of the visibility of a measured point, or the weights of this evidence."""

    keypoint: float  # confidence of the keypoint; 0 if absent
    has_keypoint: float  # 1 if there is a keypoint, else 0
    keypoint_off_m: float  # distance from the pixel of the keypoint, at the depth of the point
    before_other: float  # [m] depth of the other hand or foot behind the surface
    beside_other: float  # [m] distance to the other hand or foot in the image
    off: float  # [standard deviations] distance from the expected position
    off_other: float  # [standard deviations] distance from the other limb's position by the body
    off_pixel: float  # [standard deviations] distance in the image from the expected position
    before_body: float  # [m] depth of the position by the body behind the surface
    before: float  # [m] depth of the expected position behind the surface
    own_end: float  # 1 if the surface leads to the end of a limb of its kind, else 0
    off_along_m: float  # difference of the geodesic distance from its reference
    end: float  # persistence of the matched end of the limb, 0 to 1; 0 if none


@dataclass(frozen=True)
class Visibility:
    """Log-odds of visibility: the sum of weighted evidence and a bias, with a minimum value."""

    weights: LimbEvidence
    bias: float
    least: float  # minimum log-odds of a measured point
    off_pixel_max: float = np.inf  # maximum of off_pixel at a distinct end of a limb

    def odds(self, evidence: LimbEvidence) -> float:
        """Return the log-odds that a point with this evidence is visible."""
        if evidence.end >= DISTINCT_END and evidence.off_pixel > self.off_pixel_max:
            evidence = evidence._replace(off_pixel=self.off_pixel_max)
        return float(np.dot(self.weights, evidence)) + self.bias


# Fitted to one half of the bodies and styles, see benchmarks/gait_bodies.md.
VISIBILITY: Mapping[str, Visibility] = MappingProxyType(
    {
        "hand": Visibility(
            LimbEvidence(9.8, -6.6, -20.1, 2.9, 1.8, -1.0, 0.2, -0.1, 2.2, -2.9, 0.6, -1.4, 0.0),
            bias=3.3,
            least=3.0,
        ),
        "foot": Visibility(
            LimbEvidence(4.7, -1.3, -6.0, 3.7, 1.7, -0.7, 0.2, 0.4, -0.4, -5.4, 0.1, -1.9, 0.0),
            bias=0.7,
            least=2.7,
        ),
    }
)

# Regression without keypoints, fitted to the tuning split of two simulators.
NO_WEIGHTS = LimbEvidence(*[0.0] * len(LimbEvidence._fields))
WITHOUT_KEYPOINTS: Mapping[str, Visibility] = MappingProxyType(
    {
        "hand": Visibility(
            NO_WEIGHTS._replace(
                before_other=2.6, beside_other=3.4, off=-1.3, off_pixel=-2.6, end=1.9
            ),
            bias=1.6,
            least=1.5,
            off_pixel_max=1.5,
        ),
        "foot": Visibility(
            NO_WEIGHTS._replace(
                before_other=3.4,
                beside_other=5.3,
                off=-1.1,
                off_pixel=-0.8,
                off_along_m=-3.6,
                end=1.9,
            ),
            bias=1.8,
            least=2.0,
        ),
    }
)


def shank_points_away(anchor: Anchor | None, body: MeasuredBody, info: CameraInfo) -> bool:
    """Check that a shank points away from the camera: it hides its own ankle, as in a swing.

    The foot may be visible below, but the surface at the ankle belongs to the shank.
    """
    if anchor is None or anchor.joint is None or anchor.before is None:
        return False
    vertices = body.mesh.vertices_at(np.stack([anchor.joint, anchor.before]))
    if (vertices < 0).any():
        return False
    ankle_m, knee_m = body.mesh.points_m[vertices, 2]
    length_m = float(np.linalg.norm(anchor.joint - anchor.before)) * knee_m / info.fx
    return bool(ankle_m - knee_m > AWAY_M and length_m < AWAY_SHARE * SHANK * body.stature_m)


def limb_evidence(
    point: PointFilter, body: MeasuredBody, evidence: PointEvidence, info: CameraInfo
) -> LimbEvidence | None:
    """Return the evidence of a point at its measured position; None if none is expected."""
    expected, prior, surface = point.expected_position(), point.prior, evidence.surface
    if expected is None or prior is None or surface is None:
        return None
    anchor, other, position_m = evidence.anchor, evidence.counterpart, surface.position_m
    pixel = project(position_m, info)[0]
    by_body, off_ray2 = prior.on_ray(position_m, PIXEL_SIGMA, info)
    there, _ = expected.on_ray(position_m, PIXEL_SIGMA, info)
    basin = int(body.extrema.basin[surface.vertex])
    along = abs(float(body.geodesic_m[surface.vertex]) - point.geodesic_m)
    before_other, beside_other, off_other = 0.0, 0.5, 5.0**0.5
    if other is not None and other.motion is not None and other.alive:
        there_m = other.motion.position_m
        metre_px = info.fx / position_m[2]
        beside_other = float(np.linalg.norm(project(there_m, info)[0] - pixel)) / metre_px
        before_other = float(there_m[2] - position_m[2])
        if other.prior is not None:
            off_other = float(np.sqrt(other.prior.distances2(position_m[None])[0]))
    return LimbEvidence(
        keypoint=0.0 if anchor is None else anchor.confidence,
        has_keypoint=float(anchor is not None),
        keypoint_off_m=0.15
        if anchor is None
        else min(float(np.linalg.norm(pixel - anchor.pixel)) * position_m[2] / info.fx, 0.3),
        before_other=min(max(before_other, -0.4), 0.4),
        beside_other=min(beside_other, 0.5),
        off=min(float(np.sqrt(expected.distances2(position_m[None])[0])), SIGMAS_MAX),
        off_other=min(off_other, SIGMAS_MAX),
        off_pixel=min(off_ray2**0.5, SIGMAS_MAX),
        before_body=_before(by_body.mean_m[2] - position_m[2]),
        before=_before(there.mean_m[2] - position_m[2]),
        own_end=float(basin >= 0 and body.kinds[basin] == point.kind),
        off_along_m=min(along, 0.5) if np.isfinite(along) else 0.5,
        end=0.0 if evidence.extremity is None else evidence.extremity.strength,
    )


def _before(offset_m: float) -> float:
    return min(max(float(offset_m), -0.3), 0.5)
