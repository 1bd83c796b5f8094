"""When and where the feet come down, planned from the whole way of a person.

A foot is put where the body will be in the middle of its stance, so feet turn, start and stop as
the body does. Every stretch of walking or turning is cut into whole steps: it begins and ends
with both feet below the body.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label

from common.messages import F64
from services.camera.lab.gait import step_length_m, swing_share
from services.camera.lab.walker import STEP_S

SIDES = (1.0, -1.0)  # left, right; index 0 and 1 in all arrays of feet

MOVING_MPS, TURNING_RADPS = 0.03, 0.08  # slower than that, feet stay where they are
TURN_STEP_RAD = 0.8  # turned with each step on the spot
SLOWEST_STEPS_HZ = 1.2
PAUSE_S = 0.6  # shorter stops are stepped through
SHORTEST_S = 0.3  # less is no time for two steps: the feet stay
DELAY_S, AFTER_S = 0.15, 0.25  # steps begin after the body moves and end after it rests
MIDSTANCE = 0.365  # part of the stance after which the body is above the foot
WALKING_HALF_WIDTH_M = 0.055  # of the base of support, ankle to the middle
TOE_OUT_RAD = math.radians(7.0)


@dataclass(frozen=True)
class Track:
    """The way of one person; arrays are T long in steps of STEP_S, frame: map."""

    times_s: F64
    x_m: F64
    y_m: F64
    yaw_rad: F64
    speed_mps: F64
    turn_radps: F64


@dataclass(frozen=True)
class Feet:
    """The stances of one foot, K of them; stance k lasts from down_s[k] to up_s[k].

    Args:
        down_s: The first is -inf.
        up_s: The last is inf.
        place: Kx3: x and y of the ankle and yaw of the foot while it is flat, frame: map.
    """

    down_s: F64
    up_s: F64
    place: F64


@dataclass(frozen=True)
class Steps:
    """All steps of one person.

    Args:
        feet: Left and right.
        phase: T, cycles of the left leg: whole at left heel contact; creeps while standing.
        stepping: T, true while stepping.
    """

    feet: tuple[Feet, Feet]
    phase: F64
    stepping: F64


@dataclass(frozen=True)
class Build:
    """What of a person's body the steps depend on."""

    stature_m: float
    ankle_ahead_m: float  # of the hips, standing
    half_stance_m: float  # ankle to the middle, standing
    quickness: float = 1.0  # cadence over that of the average person


def plan_steps(track: Track, build: Build, first: int) -> Steps:
    """Plan all steps.

    Args:
        track: The way.
        build: Of the person.
        first: The foot that likes to step first, 0 left or 1 right.
    """
    rate = _step_rate(track, build)
    bouts = _bouts(track)
    down: tuple[list[float], list[float]] = ([-math.inf], [-math.inf])
    up: tuple[list[float], list[float]] = ([], [])
    above: tuple[list[float], list[float]] = ([track.times_s[0]], [track.times_s[0]])
    knots: list[tuple[F64, F64]] = []
    stepping = np.zeros(len(track.times_s))
    cycle = 0.0
    for begin, end in bouts:
        stepping[begin:end] = 1.0
        part = slice(begin, end)
        foot = _first_foot(track, part, first)
        count, progress = _whole_steps(rate[part], swing := _mean_swing(track, part))
        times = track.times_s[part]

        def when(at: float, progress: F64 = progress, times: F64 = times) -> float:
            return float(np.interp(at, progress, times))

        for step in range(count):
            side = (foot + step) % 2
            up[side].append(when(step))
            down[side].append(when(step + swing))
            stands = step + 2 < count  # and is lifted again in this bout
            middle = step + swing + MIDSTANCE * (2.0 - swing)
            above[side].append(when(middle) if stands else float(times[-1]))
        # The left foot comes down at whole cycles.
        lands = math.ceil(cycle - foot / 2 + 0.25) + foot / 2
        knots.append((times, lands + (progress - swing) / 2))
        cycle = float(knots[-1][1][-1])
    return Steps(
        feet=(
            Feet(np.array(down[0]), np.array([*up[0], math.inf]), _places(track, build, above, 0)),
            Feet(np.array(down[1]), np.array([*up[1], math.inf]), _places(track, build, above, 1)),
        ),
        phase=_fill(track.times_s, knots),
        stepping=stepping,
    )


def _step_rate(track: Track, build: Build) -> F64:
    """Return steps per second from speed and turn rate."""
    speed = np.maximum(track.speed_mps, 1e-3)
    walking = speed / step_length_m(speed, build.stature_m) * build.quickness
    turning = np.abs(track.turn_radps) / TURN_STEP_RAD
    # The larger of both, smoothly; turning costs no more steps than walking fast.
    return np.asarray((walking**4 + turning**4) ** 0.25)


def _bouts(track: Track) -> list[tuple[int, int]]:
    """Return the stretches of stepping, as ranges of indices."""
    moving = (track.speed_mps > MOVING_MPS) | (np.abs(track.turn_radps) > TURNING_RADPS)
    marks, count = label(~moving)
    for gap in range(1, count + 1):
        inside = np.flatnonzero(marks == gap)
        at_edge = inside[0] == 0 or inside[-1] == len(moving) - 1
        if len(inside) * STEP_S < PAUSE_S and not at_edge:
            moving[inside] = True
    marks, count = label(moving)
    bouts = []
    for bout in range(1, count + 1):
        inside = np.flatnonzero(marks == bout)
        begin = int(inside[0] + round(DELAY_S / STEP_S))
        end = min(len(moving), int(inside[-1] + round(AFTER_S / STEP_S)))
        if (end - begin) * STEP_S > SHORTEST_S:
            bouts.append((begin, end))
    return bouts


def _first_foot(track: Track, part: slice, liked: int) -> int:
    """Return the foot that steps first: the inner one of a turn."""
    turned = track.yaw_rad[part][: round(0.6 / STEP_S)]
    angle = float(turned[-1] - turned[0])
    if abs(angle) < 0.25:
        return liked
    return 0 if angle > 0 else 1


def _mean_swing(track: Track, part: slice) -> float:
    """Return the duration of a swing in steps: two steps are a cycle."""
    speed = float(np.mean(track.speed_mps[part]))
    turning = float(np.mean(np.abs(track.turn_radps[part])))
    return 2.0 * float(swing_share(speed + 0.4 * turning))


def _whole_steps(rate: F64, swing: float) -> tuple[int, F64]:
    """Return the number of steps of a bout and the progress in steps at each time.

    The last step ends with the bout: progress runs from 0 to steps - 1 + swing.
    """
    progress = np.concatenate([[0.0], np.cumsum(np.maximum(rate, SLOWEST_STEPS_HZ)[1:] * STEP_S)])
    count = max(2, round(float(progress[-1]) + 1.0 - swing))
    return count, progress * ((count - 1 + swing) / progress[-1])


def _places(track: Track, build: Build, above: tuple[list[float], list[float]], side: int) -> F64:
    """Return where a foot stands, from the times at which the body is above it."""
    times = np.array(above[side])
    yaw = np.interp(times, track.times_s, track.yaw_rad)
    speed = np.interp(times, track.times_s, track.speed_mps)
    x, y = (np.interp(times, track.times_s, values) for values in (track.x_m, track.y_m))
    slow = np.clip(1.0 - speed / 0.7, 0.0, 1.0)
    width = WALKING_HALF_WIDTH_M + (build.half_stance_m - WALKING_HALF_WIDTH_M) * slow
    left = SIDES[side] * width
    return np.stack(
        [
            x + np.cos(yaw) * build.ankle_ahead_m - np.sin(yaw) * left,
            y + np.sin(yaw) * build.ankle_ahead_m + np.cos(yaw) * left,
            yaw + SIDES[side] * TOE_OUT_RAD,
        ],
        axis=-1,
    )


def _fill(times_s: F64, knots: list[tuple[F64, F64]]) -> F64:
    """Return the phase at all times, creeping from one bout to the next."""
    if not knots:
        return np.zeros_like(times_s)
    known_s = np.concatenate([times for times, _ in knots])
    return np.asarray(np.interp(times_s, known_s, np.concatenate([phase for _, phase in knots])))
