"""Feet that stay where they stand, and legs that reach them."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from common.messages import F64
from services.camera.lab.footfalls import Feet
from services.camera.lab.gait import LIFT_OFF, Gait
from services.camera.lab.posture import Skeleton
from services.camera.lab.rotations import about_y, about_z, along, turn

FLAT = 0.25  # phase at which the whole sole is on the floor
REFERENCE_STRIDE_M = 1.40  # of the table's foot pitch
CLEARANCE_M = 0.03  # of the lowest point of the sole, most in the first half of the swing
TOE_BEND_RAD, TOE_STIFFENING_RAD = 0.25, 0.1  # then the foot rolls over the tip of the toes
LANDING = 3.0  # times the clearance: how steeply the heel comes down
PUSH_SHARE = 0.4  # of the swing's mean velocity, that push-off adds to the rolling foot's
LEAST_PITCH_SHARE = 0.3  # of the table's foot pitch even in the smallest step
REACH = 0.9985  # of the straight leg: the knee stays bent by 6 degrees
SMOOTH_STEPS = 4  # over which the pelvis is lowered when a foot is out of reach


@dataclass(frozen=True)
class FootPath:
    """One foot over time.

    Args:
        ankle_m: Tx3, frame: map.
        map_from_foot: Tx3x3.
    """

    ankle_m: F64
    map_from_foot: F64


def foot_path(feet: Feet, skeleton: Skeleton, side: int, gait: Gait, times_s: F64) -> FootPath:
    """Return how a foot moves: heel first, flat, rolling about the ball, swinging on.

    Args:
        feet: Its stances.
        skeleton: Of the person.
        side: 0 left, 1 right.
        gait: Normative curves.
        times_s: T, ascending.
    """
    now = np.clip(np.searchsorted(feet.down_s, times_s, side="right") - 1, 0, None)
    after = np.minimum(now + 1, len(feet.down_s) - 1)
    swing_s = np.maximum(feet.down_s[1:] - feet.up_s[:-1], 1e-3)
    stride = np.linalg.norm(np.diff(feet.place[:, :2], axis=0), axis=-1)
    share = np.clip(stride / REFERENCE_STRIDE_M, LEAST_PITCH_SHARE, 1.1)
    # The first stance follows no swing, the last precedes none.
    before_s, before_share = np.append(np.inf, swing_s), np.append(0.0, share)
    after_s, after_share = np.append(swing_s, np.inf), np.append(share, 0.0)

    with np.errstate(invalid="ignore"):
        # Seconds become phases at the pace of the swing next to them.
        pace = 1.0 - LIFT_OFF
        since = np.nan_to_num((times_s - feet.down_s[now]) * pace / before_s[now], posinf=9.0)
        until = np.nan_to_num((feet.up_s[now] - times_s) * pace / after_s[now], posinf=9.0)
        part = np.clip((times_s - feet.up_s[now]) / after_s[now], 0.0, 1.0)
    part = np.nan_to_num(part)
    in_swing = times_s >= feet.up_s[now]
    contact = np.clip(since, 0.0, FLAT)
    push = np.clip(LIFT_OFF - until, FLAT, LIFT_OFF)
    pitch = np.radians(
        np.where(
            in_swing,
            after_share[now] * gait.curve("foot.pitch_deg", LIFT_OFF + part * pace),
            before_share[now] * gait.curve("foot.pitch_deg", contact)
            + after_share[now] * gait.curve("foot.pitch_deg", push),
        )
    )
    stand = _standing_ankle(feet.place[now], pitch, skeleton, side)
    if not in_swing.any():
        return FootPath(stand, about_z(feet.place[now, 2]) @ about_y(-pitch))

    ease = part * part * (3.0 - 2.0 * part)
    yaw = feet.place[now, 2] + ease * (feet.place[after, 2] - feet.place[now, 2])
    ankle = np.where(in_swing[:, None], _swinging_ankle(feet, skeleton, side, gait, times_s), stand)
    part = np.where(in_swing, part, 0.0)
    # Most in the first half; at the end the heel still comes down.
    profile = np.sin(np.pi * part**0.6) ** 2 + LANDING * part**2 * (1.0 - part)
    clearance_m = CLEARANCE_M * np.minimum(after_share[now], 1.0) * profile
    ankle[:, 2] = clearance_m + _ankle_height(pitch, skeleton, side, part)
    return FootPath(ankle, about_z(yaw) @ about_y(-pitch))


def _sole(skeleton: Skeleton, side: int) -> tuple[F64, F64]:
    """Return heel and ball from the ankle, standing."""
    return (
        skeleton.heel[side] - skeleton.ankle[side],
        skeleton.ball[side] - skeleton.ankle[side],
    )


def _standing_ankle(place: F64, pitch: F64, skeleton: Skeleton, side: int) -> F64:
    """Return the ankle of a foot that rolls over heel or ball where it stands."""
    heel, ball = _sole(skeleton, side)
    toes = _toes(skeleton, side)
    pivot = np.where((pitch > 0.0)[:, None], heel, ball)
    rise = toes - turn(about_y(_toe_roll(pitch)), toes)  # of the ball, about the tip of the toes
    flat = pivot - turn(about_y(-pitch), pivot) + rise  # the ankle, in the frame of the flat foot
    ankle = turn(about_z(place[:, 2]), flat)
    ankle[:, :2] += place[:, :2]
    ankle[:, 2] -= pivot[:, 2]
    return ankle


def _toes(skeleton: Skeleton, side: int) -> F64:
    """Return the tip of the toes from the ball, standing, along the floor."""
    return np.asarray((skeleton.toe[side] - skeleton.ball[side]) * (1.0, 0.0, 0.0))


def _toe_roll(pitch: F64) -> F64:
    """Return how far the toes leave the floor when they bend no further, radians."""
    over = (-pitch - TOE_BEND_RAD) / TOE_STIFFENING_RAD
    return np.asarray(TOE_STIFFENING_RAD * np.logaddexp(0.0, over))


def _ankle_height(pitch: F64, skeleton: Skeleton, side: int, part: F64) -> F64:
    """Return the height of the ankle at which the sole touches the floor."""
    heel, ball = (turn(about_y(-pitch), point)[:, 2] for point in _sole(skeleton, side))
    # In the swing heel and ball change roles while the foot turns: rounded, not with a kink.
    roundness_m = 1e-6 + 0.03 * np.sin(np.pi * part) ** 2
    half = np.sqrt((heel - ball) ** 2 / 4.0 + roundness_m**2)
    lowest = (heel + ball) / 2.0 - half
    rise = np.sin(_toe_roll(pitch)) * _toes(skeleton, side)[0]
    return np.asarray(rise - lowest)


def _swinging_ankle(feet: Feet, skeleton: Skeleton, side: int, gait: Gait, times_s: F64) -> F64:
    """Return the ankle in the swings; x and y only mean something.

    Each swing is the cubic that leaves and meets the rolling foot with its velocities.
    """
    ankle = np.zeros((len(times_s), 3))
    for k in range(len(feet.up_s) - 1):
        begin_s, end_s = feet.up_s[k], feet.down_s[k + 1]
        inside = (times_s >= begin_s) & (times_s <= end_s)
        if not inside.any():
            continue
        stride = float(np.linalg.norm(feet.place[k + 1, :2] - feet.place[k, :2]))
        share = min(1.1, max(LEAST_PITCH_SHARE, stride / REFERENCE_STRIDE_M))
        leave = _rolling(feet.place[k], skeleton, side, gait, (LIFT_OFF, share))
        meet = _rolling(feet.place[k + 1], skeleton, side, gait, (1.0, share))
        pace = 1.0 - LIFT_OFF
        s = ((times_s[inside] - begin_s) / (end_s - begin_s))[:, None]
        ankle[inside] = (
            (2 * s**3 - 3 * s**2 + 1) * leave[0]
            + (s**3 - 2 * s**2 + s) * (leave[1] * pace + PUSH_SHARE * (meet[0] - leave[0]))
            + (3 * s**2 - 2 * s**3) * meet[0]
            + (s**3 - s**2) * meet[1] * pace
        )
    return ankle


def _rolling(
    place: F64, skeleton: Skeleton, side: int, gait: Gait, at: tuple[float, float]
) -> tuple[F64, F64]:
    """Return the standing ankle at a phase and share of pitch, and its change by phase."""
    phase, share = at
    step = 0.005
    # On the side of the stance: before lift-off, after contact.
    phases = np.array([phase, phase - step if phase < 1.0 else phase + step])
    pitch = np.radians(share * gait.curve("foot.pitch_deg", phases))
    ankle = _standing_ankle(np.repeat(place[None], 2, axis=0), pitch, skeleton, side)
    return ankle[0], (ankle[1] - ankle[0]) / (phases[1] - phases[0])


def lacking_height_m(hip_m: F64, ankle_m: F64, skeleton: Skeleton, side: int) -> F64:
    """Return how far the hip must come down so that the leg reaches the ankle, T, at least 0."""
    length = REACH * sum(_lengths(skeleton, side))
    aside = np.sum((ankle_m - hip_m)[:, :2] ** 2, axis=-1)
    highest = ankle_m[:, 2] + np.sqrt(np.maximum(length**2 - aside, 0.01))
    return np.asarray(np.maximum(hip_m[:, 2] - highest, 0.0))


def smooth_cover(values: F64) -> F64:
    """Return a smooth curve that is nowhere below the values."""
    size = 2 * SMOOTH_STEPS + 1
    cover = maximum_filter1d(values, 2 * size - 1, mode="nearest")
    for _ in range(2):
        cover = uniform_filter1d(cover, size, mode="nearest")
    return np.asarray(cover)


def _lengths(skeleton: Skeleton, side: int) -> tuple[float, float]:
    """Return the lengths of thigh and shank."""
    thigh = skeleton.knee[side] - skeleton.hip[side]
    shank = skeleton.ankle[side] - skeleton.knee[side]
    return float(np.linalg.norm(thigh)), float(np.linalg.norm(shank))


def bend_leg(hip_m: F64, foot: FootPath, forward: F64, skeleton: Skeleton, side: int) -> F64:
    """Return the rotations of thigh and shank that bring the ankle to the foot.

    Args:
        hip_m: Tx3, frame: map.
        foot: Where the ankle shall be.
        forward: Tx3, where the knee points, frame: map.
        skeleton: Of the person.
        side: 0 left, 1 right.

    Returns:
        2xTx3x3, map_from_thigh and map_from_shank.
    """
    thigh, shank = _lengths(skeleton, side)
    leg = foot.ankle_m - hip_m
    distance = np.linalg.norm(leg, axis=-1, keepdims=True)
    axis = leg / distance
    distance = np.clip(distance, abs(thigh - shank) + 0.02, 0.9995 * (thigh + shank))
    lateral = np.cross(forward, axis)
    lateral /= np.linalg.norm(lateral, axis=-1, keepdims=True)
    along_axis = (distance**2 + thigh**2 - shank**2) / (2.0 * distance)
    ahead = np.sqrt(np.maximum(thigh**2 - along_axis**2, 0.0))
    knee = axis * along_axis + np.cross(axis, lateral) * ahead
    left = np.array([0.0, 1.0, 0.0])
    rest = [
        along(skeleton.knee[side] - skeleton.hip[side], left),
        along(skeleton.ankle[side] - skeleton.knee[side], left),
    ]
    return np.stack(
        [
            along(knee, lateral) @ rest[0].T,
            along(axis * distance - knee, lateral) @ rest[1].T,
        ]
    )
