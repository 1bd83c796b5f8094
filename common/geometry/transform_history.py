"""A rigid transform over time: a base that drives, or a camera that is turned."""

import bisect
import math
from collections import Counter
from dataclasses import dataclass

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from common.geometry.transforms import invert, transform_from
from people4d.messages import F64

SPEED_BASE_S = 0.04  # [s] least time that a speed is taken over
COUNTERS = ("motion_duplicates", "motion_jumps", "motion_gaps", "motion_clock_resets")


class TransformBufferConfig(msgspec.Struct, frozen=True, kw_only=True):
    """What motions are believed. All values are this project's."""

    keep_s: float = 5.0  # [s] of samples that are kept
    gap_s: float = 0.5  # [s] between two samples above which what lies between is a guess
    predict_s: float = 0.5  # [s] the last motion is believed to go on; after that it has stopped
    speed_max_mps: float = 5.0  # [m/s] above it the origin was set anew, not the base moved
    turn_max_radps: float = 12.0  # [rad/s] likewise
    clock_jump_s: float = 1.0  # [s] samples older than the newest by more begin a new time
    # Standard deviations of what a base does that nobody told of
    sigma_acceleration_mps2: float = 1.0  # [m/s^2]
    sigma_turn_radps2: float = 2.0  # [rad/s^2]
    # Standard deviations of the errors that odometry makes as a base moves, which grow with the
    # root of the way and of the angle; 0: it makes none
    drift_way_m: float = 0.02  # [m] in 1 m
    drift_turn_rad: float = 0.05  # [rad] in 1 rad

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if name.startswith("drift"):
                if not 0 <= value < math.inf:
                    raise ValueError(f"{name}: expected a finite number >= 0, got {value}")
            elif not 0 < value < math.inf:
                raise ValueError(f"{name}: expected a finite number > 0, got {value}")


@dataclass(frozen=True)
class Placement:
    """Where a frame is at one time.

    Args:
        matrix: 4x4, parent_from_child.
        sigma_m: Standard deviation of the place, because no sample tells it; 0 between samples.
        sigma_rad: Likewise of the direction.
    """

    matrix: F64
    sigma_m: float = 0.0
    sigma_rad: float = 0.0

    @property
    def is_guess(self) -> bool:
        """Whether no sample tells it."""
        return self.sigma_m > 0 or self.sigma_rad > 0


class TransformHistory:
    """Samples of one transform; between them it is interpolated, after them predicted.

    A sample that no motion explains means that whoever tells them counts from a new origin: the
    trail goes on from where the child was thought to be.

    Args:
        config: What is believed.
        counters: Counts `COUNTERS`.
    """

    def __init__(self, config: TransformBufferConfig, counters: Counter[str]) -> None:
        self._config = config
        self._counters = counters
        self._stamps_ns: list[int] = []
        self._matrices: list[F64] = []
        self._parent_from_told = np.eye(4)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest sample, None if there is none."""
        return self._stamps_ns[-1] if self._stamps_ns else None

    def add(self, stamp_ns: int, matrix: F64) -> None:
        """Take a sample; they may come in any order.

        Args:
            stamp_ns: Its time.
            matrix: 4x4, parent_from_child.
        """
        newest = self.newest_ns
        if newest is not None and newest - stamp_ns > self._config.clock_jump_s * 1e9:
            self._counters["motion_clock_resets"] += 1
            self._stamps_ns, self._matrices = [], []
            newest = None
        index = bisect.bisect_left(self._stamps_ns, stamp_ns)
        if index < len(self._stamps_ns) and self._stamps_ns[index] == stamp_ns:
            self._counters["motion_duplicates"] += 1
            return
        if newest is not None and stamp_ns > newest:
            self._follow(stamp_ns, matrix)
        self._stamps_ns.insert(index, stamp_ns)
        self._matrices.insert(index, self._parent_from_told @ matrix)
        self._forget()

    def at(self, stamp_ns: int) -> Placement | None:
        """Return the transform at a time; None before the first sample."""
        index = bisect.bisect_left(self._stamps_ns, stamp_ns)
        if index == len(self._stamps_ns):
            return self._predicted(stamp_ns) if index else None
        if self._stamps_ns[index] == stamp_ns:
            return Placement(self._matrices[index])
        if index == 0:
            return None
        before_ns, after_ns = self._stamps_ns[index - 1], self._stamps_ns[index]
        share = (stamp_ns - before_ns) / (after_ns - before_ns)
        matrix = moved(self._matrices[index - 1], self._matrices[index], share)
        if after_ns - before_ns <= self._config.gap_s * 1e9:
            return Placement(matrix)
        return self._guess(matrix, min(stamp_ns - before_ns, after_ns - stamp_ns))

    def _follow(self, stamp_ns: int, matrix: F64) -> None:
        """Notice a new origin, and a gap."""
        elapsed_s = (stamp_ns - self._stamps_ns[-1]) / 1e9
        self._counters["motion_gaps"] += elapsed_s > self._config.gap_s
        way = invert(self._matrices[-1]) @ self._parent_from_told @ matrix
        moved_m, turned_rad = extent(way)
        far = moved_m > self._config.speed_max_mps * elapsed_s + 0.1
        turned = turned_rad > self._config.turn_max_radps * elapsed_s + 0.1
        if far or turned:
            self._counters["motion_jumps"] += 1
            self._parent_from_told = self._predicted(stamp_ns).matrix @ invert(matrix)

    def _predicted(self, stamp_ns: int) -> Placement:
        newest_ns = self._stamps_ns[-1]
        ahead_ns = stamp_ns - newest_ns
        first = bisect.bisect_right(self._stamps_ns, newest_ns - int(SPEED_BASE_S * 1e9)) - 1
        base_ns = newest_ns - self._stamps_ns[max(first, 0)]
        if not 0 < base_ns <= self._config.gap_s * 1e9:
            return self._guess(self._matrices[-1], ahead_ns)
        goes_on_ns = min(ahead_ns, self._config.predict_s * 1e9)
        matrix = moved(self._matrices[max(first, 0)], self._matrices[-1], 1 + goes_on_ns / base_ns)
        return self._guess(matrix, ahead_ns)

    def _guess(self, matrix: F64, alone_ns: int) -> Placement:
        half_s2 = 0.5 * (alone_ns / 1e9) ** 2
        config = self._config
        return Placement(
            matrix, config.sigma_acceleration_mps2 * half_s2, config.sigma_turn_radps2 * half_s2
        )

    def _forget(self) -> None:
        oldest_ns = self._stamps_ns[-1] - int(self._config.keep_s * 1e9)
        count = bisect.bisect_left(self._stamps_ns, oldest_ns)
        del self._stamps_ns[:count], self._matrices[:count]


def extent(motion: F64) -> tuple[float, float]:
    """Return how far a rigid motion (4x4) goes [m], and by what angle it turns [rad]."""
    turned_rad = float(Rotation.from_matrix(motion[:3, :3]).magnitude())
    return float(np.linalg.norm(motion[:3, 3])), turned_rad


def moved(start: F64, end: F64, share: float) -> F64:
    """Return the transform at a share of the way between two, or beyond: steady speed and turn."""
    way = invert(start) @ end
    turn = Rotation.from_matrix(way[:3, :3]).as_rotvec()
    return transform_from(
        start[:3, 3] + share * (end[:3, 3] - start[:3, 3]),
        start[:3, :3] @ Rotation.from_rotvec(share * turn).as_matrix(),
    )
