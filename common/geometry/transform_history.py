"""A rigid transform over time: a base that drives, or a camera on a pan-tilt head."""

import bisect
from collections import Counter
from dataclasses import dataclass, replace

import cv2
import numpy as np

from common.config import Config
from common.geometry.planar_covariance import PlanarCovariance, turned
from common.geometry.transforms import invert, transform_from
from people4d.messages import F64
from people4d.messages.base import NonNegative, Positive

SPEED_BASELINE_S = 0.04  # [s] least time over which a velocity is measured
SMALL_RAD = 1e-5  # below which an angle is its sine
COUNTERS = (
    *("motion_duplicates", "motion_jumps", "motion_gaps", "motion_clock_resets"),
    *("motion_bad_covariances", "refused_transforms"),
)


class TransformBufferConfig(Config, frozen=True, kw_only=True):
    """Limits of plausible motion and its uncertainty. All values are this project's."""

    history_s: Positive = 5.0  # [s] length of the history
    gap_s: Positive = 0.5  # [s] between two samples above which interpolation is uncertain
    predict_s: Positive = 0.5  # [s] of extrapolation at constant velocity, at rest afterwards
    speed_max_mps: Positive = 5.0  # [m/s] a faster motion is a reset of the origin
    angular_speed_max_radps: Positive = 12.0  # [rad/s] likewise
    clock_jump_s: Positive = 1.0  # [s] a sample older than the newest by more restarts the history
    # Standard deviations of unobserved acceleration
    sigma_acceleration_mps2: Positive = 1.0  # [m/s^2]
    sigma_angular_acceleration_radps2: Positive = 2.0  # [rad/s^2]
    # Standard deviations of odometry drift, which grow with the root of the distance travelled and
    # of the rotation; 0: none
    drift_distance_m: NonNegative = 0.02  # [m] in 1 m
    drift_rotation_rad: NonNegative = 0.05  # [rad] in 1 rad
    # A covariance of odometry with a larger standard deviation says that the pose is unknown
    covariance_sigma_max_m: Positive = 100.0  # [m] of x and y
    covariance_sigma_max_rad: Positive = 3.2  # [rad] of theta


@dataclass(frozen=True)
class TransformEstimate:
    """A transform at one time, with the uncertainty of extrapolation."""

    matrix: F64  # 4x4, parent_from_child
    sigma_m: float = 0.0  # standard deviation of the translation; 0 at and between samples
    sigma_rad: float = 0.0  # standard deviation of the rotation, likewise
    base: PlanarCovariance | None = None  # of odometry on the way; None: unknown

    @property
    def is_uncertain(self) -> bool:
        """Extrapolated, or interpolated over a gap."""
        return self.sigma_m > 0 or self.sigma_rad > 0


class TransformHistory:
    """Samples of one transform, interpolated between them and extrapolated after the last.

    A sample that no plausible motion explains means that the origin of the source was reset: the
    history continues from the extrapolated transform. It counts `COUNTERS`.
    """

    def __init__(self, config: TransformBufferConfig, counters: Counter[str]) -> None:
        self._config = config
        self._counters = counters
        self._stamps_ns: list[int] = []
        self._matrices: list[F64] = []
        self._covariances: list[F64 | None] = []  # of x, y and theta, 3x3
        self._parent_from_origin = np.eye(4)  # of the source, which may reset it

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest sample, None if there is none."""
        return self._stamps_ns[-1] if self._stamps_ns else None

    def add(self, stamp_ns: int, matrix: F64, covariance: F64 | None = None) -> None:
        """Add a sample, 4x4 parent_from_child, in any order, with that of x, y and theta (3x3)."""
        newest = self.newest_ns
        if newest is not None and newest - stamp_ns > self._config.clock_jump_s * 1e9:
            self._counters["motion_clock_resets"] += 1
            self._stamps_ns, self._matrices, self._covariances = [], [], []
            newest = None
        index = bisect.bisect_left(self._stamps_ns, stamp_ns)
        if index < len(self._stamps_ns) and self._stamps_ns[index] == stamp_ns:
            self._counters["motion_duplicates"] += 1
            return
        if newest is not None and stamp_ns > newest:
            self._check_motion(stamp_ns, matrix)
        self._stamps_ns.insert(index, stamp_ns)
        self._matrices.insert(index, self._parent_from_origin @ matrix)
        if covariance is not None:
            covariance = turned(covariance, self._parent_from_origin)
        self._covariances.insert(index, covariance)
        oldest_ns = self._stamps_ns[-1] - int(self._config.history_s * 1e9)
        count = bisect.bisect_left(self._stamps_ns, oldest_ns)
        del self._stamps_ns[:count], self._matrices[:count], self._covariances[:count]

    def at(self, stamp_ns: int) -> TransformEstimate | None:
        """Return the transform at a time; None before the first sample."""
        index = bisect.bisect_left(self._stamps_ns, stamp_ns)
        if index == len(self._stamps_ns):
            return self._extrapolate(stamp_ns) if index else None
        if self._stamps_ns[index] == stamp_ns:
            return self._estimate(self._matrices[index], self._covariances[index])
        if index == 0:
            return None
        before_ns, after_ns = self._stamps_ns[index - 1], self._stamps_ns[index]
        fraction = (stamp_ns - before_ns) / (after_ns - before_ns)
        matrix = interpolate(self._matrices[index - 1], self._matrices[index], fraction)
        before, after = self._covariances[index - 1], self._covariances[index]
        covariance = None
        if before is not None and after is not None:
            covariance = before + fraction * (after - before)
        if after_ns - before_ns <= self._config.gap_s * 1e9:
            return self._estimate(matrix, covariance)
        return self._uncertain(matrix, covariance, min(stamp_ns - before_ns, after_ns - stamp_ns))

    def _estimate(self, matrix: F64, covariance: F64 | None) -> TransformEstimate:
        base = None if covariance is None else PlanarCovariance(covariance, matrix[:2, 3])
        return TransformEstimate(matrix, base=base)

    def _check_motion(self, stamp_ns: int, matrix: F64) -> None:
        """Detect a gap, and a reset of the origin."""
        elapsed_s = (stamp_ns - self._stamps_ns[-1]) / 1e9
        self._counters["motion_gaps"] += elapsed_s > self._config.gap_s
        motion = invert(self._matrices[-1]) @ self._parent_from_origin @ matrix
        distance_m, rotation_rad = displacement(motion)
        if (
            distance_m > self._config.speed_max_mps * elapsed_s + 0.1
            or rotation_rad > self._config.angular_speed_max_radps * elapsed_s + 0.1
        ):
            self._counters["motion_jumps"] += 1
            self._parent_from_origin = self._extrapolate(stamp_ns).matrix @ invert(matrix)

    def _extrapolate(self, stamp_ns: int) -> TransformEstimate:
        newest_ns = self._stamps_ns[-1]
        ahead_ns = stamp_ns - newest_ns
        baseline_ns = newest_ns - int(SPEED_BASELINE_S * 1e9)
        first = max(bisect.bisect_right(self._stamps_ns, baseline_ns) - 1, 0)
        measured_ns = newest_ns - self._stamps_ns[first]
        matrix = self._matrices[-1]
        if 0 < measured_ns <= self._config.gap_s * 1e9:
            moving_ns = min(ahead_ns, self._config.predict_s * 1e9)
            matrix = interpolate(self._matrices[first], matrix, 1 + moving_ns / measured_ns)
        return self._uncertain(matrix, self._covariances[-1], ahead_ns)

    def _uncertain(
        self, matrix: F64, covariance: F64 | None, unobserved_ns: int
    ) -> TransformEstimate:
        half_s2 = 0.5 * (unobserved_ns / 1e9) ** 2
        config = self._config
        return replace(
            self._estimate(matrix, covariance),
            sigma_m=config.sigma_acceleration_mps2 * half_s2,
            sigma_rad=config.sigma_angular_acceleration_radps2 * half_s2,
        )


def displacement(motion: F64) -> tuple[float, float]:
    """Return the length of the translation [m] and the angle of the rotation [rad] of a 4x4."""
    angle_rad = float(np.linalg.norm(rotation_vector(motion[:3, :3])))
    return float(np.linalg.norm(motion[:3, 3])), angle_rad


def rotation_vector(rotation: F64) -> F64:
    """Return the axis of a rotation (3x3), as long as its angle is [rad]."""
    a = rotation
    sines: F64 = np.array([a[2, 1] - a[1, 2], a[0, 2] - a[2, 0], a[1, 0] - a[0, 1]], float) / 2
    if np.linalg.norm(sines) < SMALL_RAD and np.trace(a) > 0:
        return sines  # cv2.Rodrigues would return zero
    return np.asarray(cv2.Rodrigues(rotation)[0], float).ravel()


def interpolate(start: F64, end: F64, fraction: float) -> F64:
    """Return the transform between two at constant velocity; fractions beyond 0..1 extrapolate."""
    turn_rad = rotation_vector((invert(start) @ end)[:3, :3])
    return transform_from(
        start[:3, 3] + fraction * (end[:3, 3] - start[:3, 3]),
        start[:3, :3] @ cv2.Rodrigues(fraction * turn_rad)[0],
    )
