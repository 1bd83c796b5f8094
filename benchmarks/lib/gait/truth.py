"""True positions of hands and feet, and true steps, of people by their joints.

Hands and feet are on the surface of the body, joints are inside of it. The reference of a hand is
beyond the wrist along the forearm, the reference of a foot ahead of the ankle; both are moved
towards the camera.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from lab.truth.motion_capture import Footfall
from people4d.messages import F64

JOINT = (9, 10, 15, 16)  # COCO: wrists, ankles
BEFORE = (7, 8, 13, 14)  # elbows, knees
HAND_REACH = 0.35  # distance from the wrist to the middle of the hand [forearms]
HAND_DEEP_M, FOOT_DEEP_M = 0.02, 0.03  # distance from the middle to the visible surface [m]
FOOT_AHEAD_M, FOOT_BELOW_M = 0.08, 0.03  # offset from the ankle to the middle of the foot [m]
STEP_SPEED_MPS = 0.45  # Minimum speed of an ankle in a swing [m/s]
STEP_MIN_M, STEP_MIN_S = 0.2, 0.12
PAUSE = 0.5  # Minimum relative excess of the time of a stride with a pause
STEP_MAX_S = 1.5  # Maximum time between landings [s]; longer is a pause
SLOW = 1.6  # Minimum time of a step of a turn, start or stop [median steps]


def references(joints_m: F64, camera_m: F64) -> F64:
    """Return the middles of hands and feet of K people in N frames: NxKx4x3.

    Args:
        joints_m: NxKx17x3, COCO order, a fixed frame with z up.
        camera_m: Nx3, position of the camera.
    """
    found = np.empty((*joints_m.shape[:2], 4, 3))
    shoulders = joints_m[:, :, 6] - joints_m[:, :, 5]
    hips = joints_m[:, :, 12] - joints_m[:, :, 11]
    across = (shoulders + hips) * (1.0, 1.0, 0.0)
    ahead = np.cross((0.0, 0.0, 1.0), across)  # vector from left to right, turned ahead
    ahead /= np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-9)
    for k, (joint, before) in enumerate(zip(JOINT, BEFORE, strict=True)):
        end = joints_m[:, :, joint]
        if k < 2:
            middle = end + HAND_REACH * (end - joints_m[:, :, before])
            deep = HAND_DEEP_M
        else:
            middle = end + FOOT_AHEAD_M * ahead - (0.0, 0.0, FOOT_BELOW_M)
            deep = FOOT_DEEP_M
        ray = middle - camera_m[:, None]
        found[:, :, k] = middle - deep * ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    return found


def steps_by_ankles(times_s: F64, ankles_m: F64, *, begun: bool = False) -> list[Footfall]:
    """Return the steps of a person from both ankles, Nx2x3: swings that displace a foot.

    `begun`: return the steps that began before the first frame instead.
    """
    found = []
    dt_s = float(np.median(np.diff(times_s)))
    half = max(1, round(0.05 / dt_s))
    kernel = np.ones(2 * half + 1) / (2 * half + 1)
    for side in range(2):
        padded = np.pad(ankles_m[:, side, :2], ((half, half), (0, 0)), mode="edge")
        smooth = np.stack([np.convolve(column, kernel, "valid") for column in padded.T], axis=1)
        speed = np.linalg.norm(np.gradient(smooth, times_s, axis=0), axis=1)
        other = ankles_m[:, 1 - side, :2]
        moved = np.linalg.norm(np.gradient(other, times_s, axis=0), axis=1)
        swinging = (speed > STEP_SPEED_MPS) & (speed > moved)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], swinging.astype(int), [0]])))
        for begin, end in edges.reshape(-1, 2):
            last = min(end, len(times_s) - 1)
            gone_m = float(np.linalg.norm(smooth[last] - smooth[begin]))
            complete = (begin == 0) == begun and end < len(times_s)
            if complete and gone_m >= STEP_MIN_M and times_s[last] - times_s[begin] >= STEP_MIN_S:
                found.append(Footfall(float(times_s[last]), side, smooth[last]))
    return sorted(found, key=lambda one: one.time_s)


def even_truth(falls: Sequence[Footfall]) -> tuple[float, float] | None:
    """Return the true step length in m and cadence a minute: means over strides, without pauses."""
    strides = [
        (float(np.linalg.norm(after.position_m - before.position_m)), after.time_s - before.time_s)
        for before, one, after in zip(falls, falls[1:], falls[2:], strict=False)
        if before.side == after.side != one.side
    ]
    if not strides:
        return None
    table = np.array(strides)
    even = np.abs(table[:, 1] / np.median(table[:, 1]) - 1) < PAUSE
    length_m, time_s = table[even].mean(axis=0)
    return float(length_m) / 2, 120 / float(time_s)


def steady_cadence(falls: Sequence[Footfall]) -> float | None:
    """Return the true cadence of steady walking a minute: without slow steps of turns and stops."""
    times_s = np.array(
        [one.time_s - before.time_s for before, one in pairwise(falls) if before.side != one.side]
    )
    known = times_s[times_s < STEP_MAX_S]
    if not len(known):
        return None
    return float(60 / known[known <= SLOW * np.median(known)].mean())


def true_asymmetry(falls: Sequence[Footfall]) -> float | None:
    """Return (left - right) / mean of the median step times; None with too few steps."""
    times: tuple[list[float], list[float]] = ([], [])
    for before, one in pairwise(falls):
        if before.side != one.side and one.time_s - before.time_s < STEP_MAX_S:
            times[one.side].append(one.time_s - before.time_s)
    if min(map(len, times)) < 2:
        return None
    left, right = (float(np.median(side)) for side in times)
    return 2 * (left - right) / (left + right)
