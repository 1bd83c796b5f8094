"""Walking bouts: intervals of walking or turning, in whole steps."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import label

from lab.motion.gait import step_length_m, swing_share
from lab.motion.walker import STEP_S
from people4d.messages import F64

MOVING_MPS, TURNING_RADPS = 0.03, 0.08  # minimum speed and turn rate of steps [m/s, rad/s]
TURN_STEP_RAD = 0.8  # turn with each step on the spot [rad]
STEPS_MIN_HZ = 1.2  # minimum cadence [steps/s]
PAUSE_S = 0.6  # minimum duration of a pause between bouts [s]
SHORTEST_S = 0.3  # minimum duration of a bout [s]
DELAY_S, AFTER_S = 0.15, 0.25  # delays of steps at the begin and the end of a motion [s]
TURNING_TO_STEP_S = 0.6  # duration in which a turn determines the first foot [s]


@dataclass(frozen=True)
class WalkPath:
    """Path of one person; arrays are T long in steps of STEP_S, frame: map."""

    times_s: F64
    x_m: F64
    y_m: F64
    yaw_rad: F64
    speed_mps: F64
    turn_radps: F64


@dataclass(frozen=True)
class WalkingBout:
    """Steps between two rests, alternately left and right.

    Step k begins, with the lift of a foot, when the progress is k, and ends when it is k + swing.
    """

    begin: int  # index of its first time in the path
    times_s: F64  # N
    progress: F64  # N, from 0 to count - 1 + swing: the last step ends with the bout
    count: int  # number of steps
    swing: float  # duration of a swing [steps]
    foot: int  # first foot, 0 left or 1 right

    def time_of(self, progress: float) -> float:
        """Return the time of a progress."""
        return float(np.interp(progress, self.progress, self.times_s))

    def cycles(self, done: float) -> F64:
        """Return the cycles of the left leg at all times, N, beginning at a number of cycles.

        They are integers at contacts of the left foot, and integers plus 0.5 of the right foot.
        """
        first_lands = math.ceil(done - self.foot / 2 + 0.25) + self.foot / 2
        return first_lands + (self.progress - self.swing) / 2


def find_walking_bouts(
    path: WalkPath, stature_m: float, cadence_factor: float, preferred_foot: int
) -> list[WalkingBout]:
    """Return the walking bouts of a path, cut into whole steps.

    Args:
        path: Path of the person.
        stature_m: Stature of the person.
        cadence_factor: Cadence relative to the average person.
        preferred_foot: First foot unless a turn determines it.
    """
    rate_hz = np.maximum(_step_rate(path, stature_m, cadence_factor), STEPS_MIN_HZ)
    bouts = []
    for part in _stretches(path):
        progress = np.concatenate([[0.0], np.cumsum(rate_hz[part][1:] * STEP_S)])
        swing = _swing(path, part)
        count = max(2, round(float(progress[-1]) + 1.0 - swing))
        progress *= (count - 1 + swing) / progress[-1]
        foot = _first_foot(path, part, preferred_foot)
        bouts.append(WalkingBout(part.start, path.times_s[part], progress, count, swing, foot))
    return bouts


def _step_rate(path: WalkPath, stature_m: float, cadence_factor: float) -> F64:
    speed = np.maximum(path.speed_mps, 1e-3)
    walking = speed / step_length_m(speed, stature_m) * cadence_factor
    turning = np.abs(path.turn_radps) / TURN_STEP_RAD
    # A smooth maximum: fast walkers turn without additional steps.
    return np.asarray((walking**4 + turning**4) ** 0.25)


def _stretches(path: WalkPath) -> list[slice]:
    moving = (path.speed_mps > MOVING_MPS) | (np.abs(path.turn_radps) > TURNING_RADPS)
    for pause in _runs(~moving):
        at_edge = pause.start == 0 or pause.stop == len(moving)
        if (pause.stop - pause.start) * STEP_S < PAUSE_S and not at_edge:
            moving[pause] = True
    stretches = []
    for run in _runs(moving):
        begin = run.start + round(DELAY_S / STEP_S)
        end = min(len(moving), run.stop - 1 + round(AFTER_S / STEP_S))
        if (end - begin) * STEP_S > SHORTEST_S:
            stretches.append(slice(begin, end))
    return stretches


def _runs(flags: npt.NDArray[np.bool_]) -> list[slice]:
    """Return the intervals of consecutive true flags."""
    numbers, count = label(flags)
    inside = [np.flatnonzero(numbers == number) for number in range(1, count + 1)]
    return [slice(int(indices[0]), int(indices[-1]) + 1) for indices in inside]


def _swing(path: WalkPath, part: slice) -> float:
    """Return the mean duration of a swing in steps: two steps are a cycle."""
    speed = float(np.mean(path.speed_mps[part]))
    turning = float(np.mean(np.abs(path.turn_radps[part])))
    return 2.0 * float(swing_share(speed + 0.4 * turning))


def _first_foot(path: WalkPath, part: slice, preferred: int) -> int:
    """Return the foot that steps first: the inner one of a turn."""
    turned = path.yaw_rad[part][: round(TURNING_TO_STEP_S / STEP_S)]
    angle = float(turned[-1] - turned[0])
    if abs(angle) < 0.25:
        return preferred
    return 0 if angle > 0 else 1
