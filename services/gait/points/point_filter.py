"""The particle filter of one point on a body (method book section 8.3)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from common.geometry.transforms import project
from people4d.messages import F64, CameraInfo
from services.gait.colour.motion_models import FIRST
from services.gait.colour.resampling import RESAMPLERS
from services.gait.points.config import DepthLayerConfig
from services.gait.points.limbs import Body3d
from services.gait.points.point_motion import PointMotion
from services.gait.points.points import kind_of
from services.gait.surface.mesh import I64

State = Literal["measured", "predicted", "lost"]
AWAY_M, FOCAL_PX = 3.0, 615.0  # at which the noise of particles counts as configured
SPEED_MPS = 1.5  # of a point that was just found, standard deviation


@dataclass(frozen=True)
class PointEstimate:
    """Where one point is."""

    position_m: F64  # 3, optical frame; NaN before it was first seen
    velocity_mps: F64  # 3
    covariance: F64  # 6x6, of position and velocity
    state: State
    confidence: float  # 0 to 1


@dataclass(frozen=True)
class Proposal:
    """Where a point may be, other than where its motion takes it."""

    pixel: F64  # [px] 2
    sigma_px: float
    share: float  # of the particles


class PointFilter:
    """Particles [x, y, x', y'] in the image, and the point's motion in space.

    Args:
        name: Of the point.
        config: Models and constants.
        info: Calibration.
        generator: Of random numbers.

    Source: method book section 8.3.
    """

    def __init__(
        self,
        name: str,
        config: DepthLayerConfig,
        info: CameraInfo,
        generator: np.random.Generator,
    ) -> None:
        self.name, self.kind = name, kind_of(name)
        self._config, self._info, self._generator = config, info, generator
        self._combined = config.feature == "combined"
        self.motion: PointMotion | None = None
        self.shown_m: F64 = np.full(3, np.nan)  # what is told as position
        self.particles: F64 = np.empty((0, 4))
        self.vertices: I64 = np.empty(0, np.int64)  # of the particles; -1 off the body
        self.weights: F64 = np.empty(0)
        self.spin: F64 | None = None  # reference: spin image
        self.along_m = np.nan  # reference: distance from the source
        self.first_m = np.nan  # along_m at the start
        self.below_m = np.nan  # reference: distance to the tip of the limb; NaN: at no limb
        self.confidence = 0.0
        self.missed_s = 0.0  # since it was measured
        self.contradicted = 0  # frames in a row, by its keypoint
        self.unsupported_s = 0.0  # since limb or keypoint spoke for it
        self.state: State = "lost"

    @property
    def alive(self) -> bool:
        """Whether the point is followed."""
        return self.motion is not None and self.state != "lost"

    def start(self, vertex: int, body: Body3d, spin: F64 | None) -> None:
        """Follow the point from a vertex on."""
        config = self._config
        position = body.surface.points_m[vertex]
        acceleration = config.acceleration_mps2 * (0.3 if self.kind in ("head", "") else 1.0)
        noise = self.noise_m2(position)
        self.motion = PointMotion(position, noise, SPEED_MPS, acceleration)
        self.shown_m = position
        pixel = body.surface.pixels_px[vertex]
        self.particles = np.zeros((config.particles, 4))
        self.particles[:, :2] = pixel
        self.vertices = np.full(config.particles, vertex)
        self.spin = spin
        self.along_m = self.first_m = np.nan  # unless a way leads there
        self.adapt(float(body.along_m[vertex]))
        self.state, self.missed_s, self.confidence = "measured", 0.0, 1.0
        self.unsupported_s, self.contradicted = 0.0, 0

    def propagate(self, dt_s: float, proposals: Sequence[Proposal]) -> None:
        """Move the particles, by their motion and by what else tells where the point may be."""
        config = self._config
        tau = np.array(config.tau)
        if self.motion is not None:
            self.motion.predict(dt_s)
        if self.motion is not None and self._combined:
            tau = tau * self._scale(self.motion.position_m)
            self.particles[:, 2:] = self._pixels_a_frame(dt_s)
        noise = tau * self._generator.standard_normal(self.particles.shape)
        self.particles = self.particles @ FIRST.T + noise
        taken = 0
        for proposal in proposals:
            count = int(proposal.share * len(self.particles))
            drawn = self._generator.normal(proposal.pixel, proposal.sigma_px, (count, 2))
            self.particles[taken : taken + count, :2] = drawn
            taken += count

    def settle(self, body: Body3d) -> None:
        """Find the vertices under the particles."""
        self.vertices = body.surface.vertices_at(self.particles[:, :2])

    def resample(self, weights: F64) -> None:
        """Draw the particles anew by weight; those off the body vanish."""
        self.weights = weights
        chosen = RESAMPLERS["systematic"](weights[None], self._generator)[0]
        self.particles = self.particles[chosen]

    def scatter(self, body: Body3d) -> None:
        """Draw particles about the last position, since none is on the body any more."""
        vertex = body.surface.nearest(self.shown_m)
        self.particles[:, :2] = body.surface.pixels_px[vertex]
        self.particles[:, 2:] = 0.0

    def measured(self, position_m: F64, confidence: float) -> None:
        """Take in where the particles put the point."""
        assert self.motion is not None
        self.motion.correct(position_m, self.noise_m2(position_m))
        self.shown_m = self.motion.position_m if self._combined else position_m
        self.state, self.missed_s, self.confidence = "measured", 0.0, confidence

    def adapt(self, along_m: float) -> None:
        """Let the reference distance follow what is measured, within bounds: limbs do not grow."""
        config = self._config
        if np.isfinite(along_m) and np.isnan(self.along_m):
            self.along_m = self.first_m = along_m
        elif np.isfinite(along_m):
            moved = self.along_m + config.adapt * (along_m - self.along_m)
            low, high = self.first_m - config.adapt_max_m, self.first_m + config.adapt_max_m
            self.along_m = float(np.clip(moved, low, high))

    def missed(self, dt_s: float) -> None:
        """The point was not seen: it is where its motion takes it, for a while."""
        config = self._config
        self.missed_s += dt_s
        if self.motion is None:
            return
        gone = self.missed_s > config.patience_s or self.motion.spread_m > config.spread_max_m
        if self._combined:
            self.shown_m = self.motion.position_m
            self.state = "lost" if gone or self.state == "lost" else "predicted"
        else:
            self.state = "predicted"
        self.confidence = 0.0

    def estimate(self) -> PointEstimate:
        """Return where the point is."""
        if self.motion is None:
            return PointEstimate(np.full(3, np.nan), np.zeros(3), np.eye(6), "lost", 0.0)
        motion = self.motion
        return PointEstimate(
            position_m=self.shown_m.copy(),
            velocity_mps=motion.state[3:].copy(),
            covariance=motion.covariance.copy(),
            state=self.state,
            confidence=self.confidence,
        )

    def ahead(self, dt_s: float) -> PointEstimate:
        """Return where the point will be after some time."""
        told = self.estimate()
        if self.motion is None or told.state == "lost":
            return told
        state, covariance = self.motion.ahead(dt_s)
        return PointEstimate(state[:3], state[3:], covariance, "predicted", 0.0)

    def noise_m2(self, position_m: F64) -> F64:
        """Return the covariance of a measured position, 3x3: long along the line of sight."""
        config = self._config
        ray = position_m / np.linalg.norm(position_m)
        deep = (config.noise_per_m2 * position_m[2] ** 2) ** 2
        return np.asarray(config.noise_m**2 * np.eye(3) + deep * np.outer(ray, ray))

    def _scale(self, position_m: F64) -> float:
        return float(AWAY_M / max(position_m[2], 0.3) * self._info.fx / FOCAL_PX)

    def _pixels_a_frame(self, dt_s: float) -> F64:
        """Return the motion since the last frame in the image, 2."""
        assert self.motion is not None
        before = self.motion.position_m - dt_s * self.motion.state[3:]
        both = np.stack([before, self.motion.position_m])
        if both[:, 2].min() < 0.1:
            return np.zeros(2)
        pixels = project(both, self._info)
        return np.asarray(pixels[1] - pixels[0])
