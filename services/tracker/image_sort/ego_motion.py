"""How far the camera has turned from frame to frame, by the robot's odometry.

Only headings are kept: for boxes in the image nothing else counts (method book section 7). Frames
that need the whole pose of the base take `common.geometry.transform_buffer`.
"""

import bisect
import math
from collections import Counter

from common.geometry.transform_history import COUNTERS, TransformBufferConfig
from common.geometry.transforms import wrap
from people4d.messages import Odometry
from services.tracker.image_sort.camera_turn import STILL, Turn

SPEED_BASE_NS = 40_000_000  # [ns] least time that a turn rate is taken over
JUMP_SLACK_RAD = 0.1  # [rad] a heading may be off by at any rate


class EgoMotion:
    """Headings by their stamps; between them it interpolates, after them it predicts.

    A heading that no turn explains means that the odometry counts from a new origin: the robot is
    thought to have gone on as before. What was seen is counted: duplicates, jumps, gaps, clock
    resets, and frames whose turn was guessed or not known at all.

    Args:
        config: What motions are believed.
        wait_s: Longest time in seconds that a frame waits for the sample after it.
    """

    def __init__(self, config: TransformBufferConfig, wait_s: float = 0.05) -> None:
        if not 0 <= wait_s < math.inf:
            raise ValueError(f"wait_s: expected a finite number >= 0, got {wait_s}")
        self.counters = Counter(dict.fromkeys((*COUNTERS, "turns_guessed", "turns_unknown"), 0))
        self._config = config
        self._wait_ns = int(wait_s * 1e9)
        self._stamps_ns: list[int] = []
        self._headings_rad: list[float] = []  # unwrapped, without the jumps
        self._offset_rad = 0.0  # from headings as told to these
        self._frame: tuple[float, float] | None = None  # heading and variance of the last frame

    def add(self, odometry: Odometry) -> None:
        """Take a sample; they may come in any order."""
        stamp_ns, stamps = odometry.stamp_ns, self._stamps_ns
        if stamps and stamps[-1] - stamp_ns > self._config.clock_jump_s * 1e9:
            self.counters["motion_clock_resets"] += 1
            self.reset()
        index = bisect.bisect_left(stamps, stamp_ns)
        if index < len(stamps) and stamps[index] == stamp_ns:
            self.counters["motion_duplicates"] += 1
            return
        if stamps and index == len(stamps):
            self._follow(stamp_ns, odometry.theta_rad)
        told_rad = odometry.theta_rad + self._offset_rad
        if stamps:
            beside_rad = self._headings_rad[max(index - 1, 0)]
            told_rad = beside_rad + wrap(told_rad - beside_rad)
        stamps.insert(index, stamp_ns)
        self._headings_rad.insert(index, told_rad)
        self._forget()

    def ready(self, stamp_ns: int, waited_ns: int) -> bool:
        """Tell whether a frame's turn is known, or has been waited for long enough.

        Args:
            stamp_ns: Of the frame.
            waited_ns: Since it arrived.
        """
        known = bool(self._stamps_ns) and self._stamps_ns[-1] >= stamp_ns
        return known or waited_ns >= self._wait_ns

    def turn_to(self, stamp_ns: int) -> Turn:
        """Return the turn since the last frame asked for.

        What was guessed wrong for the last frame is made good by this one's turn.

        Args:
            stamp_ns: Of the frame, in nanoseconds.
        """
        heading = self._at(stamp_ns)
        if heading is None:
            self.counters["turns_unknown"] += 1
            self._frame = None
            return STILL
        before, self._frame = self._frame, heading
        self.counters["turns_guessed"] += heading[1] > 0
        if before is None:
            return STILL
        return Turn(heading[0] - before[0], math.sqrt(max(heading[1] - before[1], 0.0)))

    def reset(self) -> None:
        """Forget all samples."""
        self._stamps_ns.clear()
        self._headings_rad.clear()
        self._offset_rad, self._frame = 0.0, None

    def _at(self, stamp_ns: int) -> tuple[float, float] | None:
        """Return heading and variance at a time, None before the first sample."""
        index = bisect.bisect_left(self._stamps_ns, stamp_ns)
        if index == len(self._stamps_ns):
            return self._predicted(stamp_ns) if index else None
        after_ns, after_rad = self._stamps_ns[index], self._headings_rad[index]
        if after_ns == stamp_ns:
            return after_rad, 0.0
        if index == 0:
            return None
        before_ns, before_rad = self._stamps_ns[index - 1], self._headings_rad[index - 1]
        share = (stamp_ns - before_ns) / (after_ns - before_ns)
        alone_ns = min(stamp_ns - before_ns, after_ns - stamp_ns)
        gap = after_ns - before_ns > self._config.gap_s * 1e9
        heading_rad = before_rad + share * (after_rad - before_rad)
        return heading_rad, self._doubt_rad2(alone_ns) if gap else 0.0

    def _predicted(self, stamp_ns: int) -> tuple[float, float]:
        """Return heading and variance after the last sample: the turn goes on, but not for ever."""
        newest_ns, newest_rad = self._stamps_ns[-1], self._headings_rad[-1]
        first = max(bisect.bisect_right(self._stamps_ns, newest_ns - SPEED_BASE_NS) - 1, 0)
        base_ns = newest_ns - self._stamps_ns[first]
        alone_ns = stamp_ns - newest_ns
        if 0 < base_ns <= self._config.gap_s * 1e9:
            goes_on_ns = min(alone_ns, self._config.predict_s * 1e9)
            newest_rad += (newest_rad - self._headings_rad[first]) * goes_on_ns / base_ns
        return newest_rad, self._doubt_rad2(alone_ns)

    def _doubt_rad2(self, alone_ns: int) -> float:
        sigma_rad = self._config.sigma_angular_acceleration_radps2 * 0.5 * (alone_ns / 1e9) ** 2
        return min(sigma_rad, math.pi) ** 2

    def _follow(self, stamp_ns: int, theta_rad: float) -> None:
        """Notice a gap, and a new origin."""
        elapsed_s = (stamp_ns - self._stamps_ns[-1]) / 1e9
        self.counters["motion_gaps"] += elapsed_s > self._config.gap_s
        turned_rad = abs(wrap(theta_rad + self._offset_rad - self._headings_rad[-1]))
        if turned_rad > self._config.angular_speed_max_radps * elapsed_s + JUMP_SLACK_RAD:
            self.counters["motion_jumps"] += 1
            self._offset_rad = self._predicted(stamp_ns)[0] - theta_rad

    def _forget(self) -> None:
        oldest_ns = self._stamps_ns[-1] - int(self._config.history_s * 1e9)
        if self._stamps_ns[0] < oldest_ns:
            count = bisect.bisect_left(self._stamps_ns, oldest_ns)
            del self._stamps_ns[:count], self._headings_rad[:count]
