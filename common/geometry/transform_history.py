"""Rigid transform over time: a driving base, or a camera on a pan-tilt head."""

import bisect
from collections import Counter
from dataclasses import dataclass, replace

import cv2
import numpy as np

from common.geometry.planar_covariance import PlanarCovariance, turned
from common.geometry.transforms import invert, transform_from
from people4d.messages import F64

HISTORY_S = 5.0  # length of the history [s]
GAP_S = 0.5  # maximum interval between two samples for certain interpolation [s]
PREDICT_S = 0.5  # maximum duration of extrapolation at constant velocity, then rest [s]
SPEED_MAX_MPS = 5.0  # maximum plausible speed; a faster motion is a reset of the origin [m/s]
ANGULAR_SPEED_MAX_RADPS = 12.0  # maximum plausible angular speed [rad/s]
CLOCK_JUMP_S = 1.0  # minimum step back of the stamps that restarts the history [s]
SIGMA_ACCELERATION_MPS2 = 1.0  # standard deviation of unobserved acceleration [m/s^2]
SIGMA_ANGULAR_ACCELERATION_RADPS2 = 2.0  # standard deviation of angular acceleration [rad/s^2]
SPEED_BASELINE_S = 0.04  # minimum interval over which velocity is measured [s]
SMALL_RAD = 1e-5  # maximum angle numerically equal to its sine [rad]
COUNTERS = (
    *("motion_duplicates", "motion_jumps", "motion_gaps", "motion_clock_resets"),
    *("motion_bad_covariances", "refused_transforms"),
)


@dataclass(frozen=True)
class TransformEstimate:
    """A transform at one time, with the uncertainty of extrapolation."""

    matrix: F64  # 4x4, parent_from_child
    sigma_m: float = 0.0  # standard deviation of the translation; 0 at and between samples
    sigma_rad: float = 0.0  # standard deviation of the rotation; 0 at and between samples
    base: PlanarCovariance | None = None  # covariance of the odometry; None: unknown

    @property
    def is_uncertain(self) -> bool:
        """True if extrapolated, or interpolated over a gap."""
        return self.sigma_m > 0 or self.sigma_rad > 0


class TransformHistory:
    """Samples of one transform, interpolated between them and extrapolated after the last.

    An implausible motion means that the source reset its origin: the history continues from the
    extrapolated transform. It counts `COUNTERS`.
    """

    def __init__(self, counters: Counter[str], history_s: float = HISTORY_S) -> None:
        self._history_ns = int(history_s * 1e9)
        self._counters = counters
        self._stamps_ns: list[int] = []
        self._matrices: list[F64] = []
        self._covariances: list[F64 | None] = []  # 3x3, of x, y and theta
        self._parent_from_origin = np.eye(4)  # origin of the source, changed by its resets

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest sample, None if there is none."""
        return self._stamps_ns[-1] if self._stamps_ns else None

    def add_sample(self, stamp_ns: int, matrix: F64, covariance: F64 | None = None) -> None:
        """Add a sample in any order: parent_from_child (4x4), covariance of x, y, theta (3x3)."""
        newest = self.newest_ns
        if newest is not None and newest - stamp_ns > CLOCK_JUMP_S * 1e9:
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
        oldest_ns = self._stamps_ns[-1] - self._history_ns
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
        if after_ns - before_ns <= GAP_S * 1e9:
            return self._estimate(matrix, covariance)
        return self._uncertain(matrix, covariance, min(stamp_ns - before_ns, after_ns - stamp_ns))

    def _estimate(self, matrix: F64, covariance: F64 | None) -> TransformEstimate:
        base = None if covariance is None else PlanarCovariance(covariance, matrix[:2, 3])
        return TransformEstimate(matrix, base=base)

    def _check_motion(self, stamp_ns: int, matrix: F64) -> None:
        """Detect a gap, and a reset of the origin."""
        elapsed_s = (stamp_ns - self._stamps_ns[-1]) / 1e9
        self._counters["motion_gaps"] += elapsed_s > GAP_S
        motion = invert(self._matrices[-1]) @ self._parent_from_origin @ matrix
        distance_m, rotation_rad = displacement(motion)
        if (
            distance_m > SPEED_MAX_MPS * elapsed_s + 0.1
            or rotation_rad > ANGULAR_SPEED_MAX_RADPS * elapsed_s + 0.1
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
        if 0 < measured_ns <= GAP_S * 1e9:
            moving_ns = min(ahead_ns, PREDICT_S * 1e9)
            matrix = interpolate(self._matrices[first], matrix, 1 + moving_ns / measured_ns)
        return self._uncertain(matrix, self._covariances[-1], ahead_ns)

    def _uncertain(
        self, matrix: F64, covariance: F64 | None, unobserved_ns: int
    ) -> TransformEstimate:
        half_s2 = 0.5 * (unobserved_ns / 1e9) ** 2
        return replace(
            self._estimate(matrix, covariance),
            sigma_m=SIGMA_ACCELERATION_MPS2 * half_s2,
            sigma_rad=SIGMA_ANGULAR_ACCELERATION_RADPS2 * half_s2,
        )


def displacement(motion: F64) -> tuple[float, float]:
    """Return the distance [m] and the angle [rad] of a motion (4x4)."""
    angle_rad = float(np.linalg.norm(rotation_vector(motion[:3, :3])))
    return float(np.linalg.norm(motion[:3, 3])), angle_rad


def rotation_vector(rotation: F64) -> F64:
    """Return the rotation vector [rad] of a rotation (3x3)."""
    a = rotation
    sines: F64 = np.array([a[2, 1] - a[1, 2], a[0, 2] - a[2, 0], a[1, 0] - a[0, 1]], float) / 2
    if np.linalg.norm(sines) < SMALL_RAD and np.trace(a) > 0:
        return sines  # cv2.Rodrigues would return zero
    return np.asarray(cv2.Rodrigues(rotation)[0], float).ravel()


def interpolate(start: F64, end: F64, fraction: float) -> F64:
    """Interpolate transforms at constant velocity; fractions outside 0..1 extrapolate."""
    turn_rad = rotation_vector((invert(start) @ end)[:3, :3])
    return transform_from(
        start[:3, 3] + fraction * (end[:3, 3] - start[:3, 3]),
        start[:3, :3] @ cv2.Rodrigues(fraction * turn_rad)[0],
    )
