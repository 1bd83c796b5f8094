"""Kalman filters of points on a body, with their expected positions relative to the body.

Source: docs/method.md, section 19.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

import numpy as np

from people4d.messages import F64, CameraInfo
from services.gait.points.body import LENGTHS_M, BodyMeter, MeasuredBody, MeshObservation
from services.gait.points.kalman import PointKalmanFilter
from services.gait.points.keypoints import HEAD, kind_of
from services.gait.points.normal import Normal

PointState = Literal["measured", "predicted", "lost"]
SPEED_MPS = 1.5  # Standard deviation of the speed of a new point [m/s]
# Standard deviation of the acceleration of a head, and of hands and feet [m/s^2]
HEAD_ACCELERATION_MPS2, ACCELERATION_MPS2 = 3.6, 12.0
NOISE_M = 0.015  # Noise of a measured position at right angles to the ray [m]
NOISE_PER_M2 = 0.004  # Depth noise of a measured position by the distance squared [m/m^2]
GATE = 5.0  # Maximum deviation of an accepted position from the prediction [standard deviations]
TIMEOUT_S = 0.4  # Maximum age of the last measurement of a tracked point [s]
HIDDEN_S = 1.5  # Maximum age of the last measurement of a point with a visible body [s]
SPREAD_MAX_M = 0.35  # Maximum standard deviation of a predicted point [m]
VAGUE_M = 0.17  # Maximum standard deviation of a published predicted hand or foot [m]
ADAPTATION = 0.03  # Adaptation of the reference distance by each measured frame
ADAPTATION_MAX_M = 0.10  # Maximum total adaptation [m]
CONTRADICTION2 = 16.0  # Maximum squared Mahalanobis distance of motion from the body's prior
UNUSUAL2 = 2.0  # Squared distance above which the prior of a followed limb widens
DAMPING_S = (
    0.05  # Time constant of an occluded point's velocity towards the velocity of the head [s]
)
# Factor of a predicted point's standard deviation, and addition [m] to it, for model errors
SPREAD, SPREAD_M = 1.5, 0.06


@dataclass(frozen=True)
class PointEstimate:
    """Position and velocity of one point."""

    position_m: F64  # 3, optical frame; NaN before the first measurement
    velocity_mps: F64  # 3
    covariance: F64  # 6x6, of position and velocity
    state: PointState
    confidence: float  # 0 to 1


class PointFilter:
    """Kalman filter of a point in space, and the state of its measurements."""

    def __init__(self, name: str) -> None:
        self.name, self.kind = name, kind_of(name)
        self.motion: PointKalmanFilter | None = None
        self.position_m: F64 = np.full(3, np.nan)  # published position
        self.geodesic_m = np.nan  # reference distance from the source
        self.initial_geodesic_m = np.nan
        self.confidence = 0.0
        self.missed_s = 0.0  # [s] time since the last measurement
        self.likely = False  # True if the measurement of a predicted point is probably correct
        self.unsupported_s = 0.0  # [s] time since an extremity or keypoint agreed
        self.state: PointState = "lost"
        self.prior: Normal | None = None  # expected position relative to the body
        self.without_keypoints = False  # True if no keypoint was ever used

    @property
    def alive(self) -> bool:
        """True if the point is measured or predicted."""
        return self.motion is not None and self.state != "lost"

    @property
    def limb_length_m(self) -> float:
        """Reference geodesic distance of the end of the limb; NaN if not connected."""
        return self.geodesic_m + LENGTHS_M[self.kind]

    @property
    def follows_limb(self) -> bool:
        """True while the end of a limb confirms a point without keypoints.

        The limb may then have any pose, for example a hand in front of the torso.
        """
        return self.without_keypoints and self.alive and self.unsupported_s == 0.0

    def expected_position(self, dt_s: float = 0.0) -> Normal | None:
        """Return the expected position after some time, by its motion and by the body.

        Motion that contradicts the body counts only while the limb or a keypoint confirms it.
        """
        if self.motion is None or not self.alive:
            return self.prior
        state, covariance = self.motion.predicted(dt_s)
        own = Normal(state[:3], np.ascontiguousarray(covariance[:3, :3]))
        if self.prior is None:
            return own
        apart = Normal(own.mean_m, own.covariance + self.prior.covariance)
        off2 = float(apart.distances2(self.prior.mean_m[None])[0])
        if off2 > CONTRADICTION2:
            return own if self.unsupported_s == 0.0 else self.prior
        if self.follows_limb:
            wider = max(off2 / UNUSUAL2, 1.0) ** 2
            return own.fused(Normal(self.prior.mean_m, wider * self.prior.covariance))
        return own.fused(self.prior)

    def start_at_vertex(self, vertex: int, body: MeasuredBody) -> None:
        """Start the point at a vertex."""
        position_m = body.mesh.points_m[vertex]
        self._start(position_m, self.noise_m2(position_m))
        self.geodesic_m = self.initial_geodesic_m = np.nan  # unless the vertex is connected
        self.adapt_reference(float(body.geodesic_m[vertex]))
        self.state, self.confidence = "measured", 1.0

    def start_beside(self, position_m: F64, noise_m2: F64) -> None:
        """Start the point in state predicted, at a position (3) off the body with noise (3x3)."""
        self._start(position_m, noise_m2)
        self.state, self.confidence, self.likely = "predicted", 0.0, True

    def _start(self, position_m: F64, noise_m2: F64) -> None:
        acceleration = HEAD_ACCELERATION_MPS2 if self.kind == "head" else ACCELERATION_MPS2
        self.motion = PointKalmanFilter(position_m, noise_m2, SPEED_MPS, acceleration)
        self.position_m = position_m
        self.missed_s = self.unsupported_s = 0.0

    def mark_measured(self, position_m: F64, confidence: float, noise_m2: F64) -> None:
        """Update by a measured position and its noise, 3x3."""
        assert self.motion is not None
        self.motion.correct(position_m, noise_m2)
        self.position_m = self.motion.position_m
        self.state, self.missed_s, self.confidence = "measured", 0.0, confidence

    def mark_doubtful(self, position_m: F64, noise_m2: F64, dt_s: float, *, likely: bool) -> None:
        """Update by a position that may be on another surface, and its noise, 3x3."""
        assert self.motion is not None
        self.motion.correct(position_m, noise_m2)
        self.mark_missed(dt_s)
        self.likely = likely

    def mark_missed(self, dt_s: float) -> None:
        """Set the position to the prediction; the point is lost after TIMEOUT_S or HIDDEN_S."""
        self.missed_s += dt_s
        self.likely = False
        if self.motion is None:
            return
        gone = self.missed_s > TIMEOUT_S or self.motion.sigma_m > SPREAD_MAX_M
        if self.prior is not None:
            gone = self.missed_s > HIDDEN_S
        self.position_m = self.motion.position_m
        self.state = "lost" if gone or self.state == "lost" else "predicted"
        self.confidence = 0.0

    def adapt_reference(self, geodesic_m: float) -> None:
        """Adapt the reference distance to a measured one, within ADAPTATION_MAX_M."""
        if np.isfinite(geodesic_m) and np.isnan(self.geodesic_m):
            self.geodesic_m = self.initial_geodesic_m = geodesic_m
        elif np.isfinite(geodesic_m):
            moved = self.geodesic_m + ADAPTATION * (geodesic_m - self.geodesic_m)
            low = self.initial_geodesic_m - ADAPTATION_MAX_M
            high = self.initial_geodesic_m + ADAPTATION_MAX_M
            self.geodesic_m = float(np.clip(moved, low, high))

    def estimate(self) -> PointEstimate:
        """Return position and velocity in the last frame."""
        if self.motion is None:
            return PointEstimate(np.full(3, np.nan), np.zeros(3), np.eye(6), "lost", 0.0)
        position_m, covariance = self.position_m.copy(), self.motion.covariance.copy()
        if self.state == "predicted" and self.likely:
            covariance[:3, :3] = SPREAD * covariance[:3, :3] + SPREAD_M**2 * np.eye(3)
        elif self.state == "predicted" and self.prior is not None:
            expected = self.expected_position() or self.prior
            position_m = expected.mean_m
            covariance[:3, :3] = SPREAD * expected.covariance + SPREAD_M**2 * np.eye(3)
            covariance[:3, 3:] = covariance[3:, :3] = 0.0
        return PointEstimate(
            position_m=position_m,
            velocity_mps=self.motion.state[3:].copy(),
            covariance=covariance,
            state="lost" if self._is_vague(covariance) else self.state,
            confidence=self.confidence,
        )

    def _is_vague(self, covariance: F64) -> bool:
        """Check for a predicted hand or foot too uncertain to publish; it may recover."""
        if self.state != "predicted" or self.kind == "head":
            return False
        return bool(np.linalg.eigvalsh(covariance[:3, :3])[-1] > VAGUE_M**2)

    def noise_m2(self, position_m: F64, besides_m2: F64 | None = None) -> F64:
        """Return the covariance of a measured position, 3x3, largest along the ray.

        `besides_m2` is the covariance without depth noise; default: `NOISE_M` in all directions.
        """
        ray = position_m / np.linalg.norm(position_m)
        depth_m2 = (NOISE_PER_M2 * position_m[2] ** 2) ** 2
        besides_m2 = NOISE_M**2 * np.eye(3) if besides_m2 is None else besides_m2
        return np.asarray(besides_m2 + depth_m2 * np.outer(ray, ray))


P = TypeVar("P", bound=PointFilter)


class PointLayer(ABC, Generic[P]):
    """Points of one person's body, by name, with the meter of the body."""

    def __init__(self, info: CameraInfo, points: Iterable[P]) -> None:
        self._info, self._meter = info, BodyMeter()
        self._points = {point.name: point for point in points}

    def start_point(self, name: str, point_m: F64, observation: MeshObservation) -> bool:
        """Start a point at the vertex nearest to a position (3, optical frame).

        Returns True if there is a body.
        """
        body = self._measure(observation)
        if body is not None:
            self._points[name].start_at_vertex(body.mesh.nearest(point_m), body)
        return body is not None

    @abstractmethod
    def update_points(self, observation: MeshObservation) -> Mapping[str, PointEstimate]:
        """Return the estimates of the points in the next frame."""

    def mark_lost(self) -> None:
        """Set all points lost, after a gap in time."""
        for point in self._points.values():
            point.state = "lost"

    @abstractmethod
    def _measure(self, observation: MeshObservation) -> MeasuredBody | None:
        """Measure the body."""

    def _estimates(self) -> Mapping[str, PointEstimate]:
        return {name: point.estimate() for name, point in self._points.items()}


def damp_occluded(points: Mapping[str, PointFilter], dt_s: float) -> None:
    """Damp the velocity of occluded points towards the velocity of the head."""
    head = points.get(HEAD)
    if head is None or head.motion is None or head.state != "measured":
        return
    ratio = 1 - float(np.exp(-dt_s / DAMPING_S))
    for point in points.values():
        if point.motion is not None and point.state != "measured":
            point.motion.damp_velocity(head.motion.state[3:], ratio)
