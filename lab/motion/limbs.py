"""Arms, with swing, rest and gestures, and legs, by inverse kinematics of the feet."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from lab.bodies.rotations import about_x, about_y, about_z, along
from lab.bodies.skeleton import Skeleton
from lab.motion import stance
from lab.motion.foot_path import FootPath
from lab.motion.footfalls import SIDES
from lab.scenario import Gesture
from people4d.messages import F64

HANDS = ("left", "right")
ABDUCTION_RAD, ELBOW_INWARD_RAD = 0.13, 0.25
REACH = 0.9985  # maximum reach, relative to the straight leg: the knee stays bent by 6 degrees
SMOOTH_STEPS = 4  # smoothing of the lowering of the pelvis [steps of the simulation]


@dataclass(frozen=True)
class ArmAngles:
    """Angles of one arm, T long or constant."""

    shoulder_deg: float | F64  # forward from hanging
    elbow_deg: float | F64  # bent from straight
    aside_rad: float | F64 = ABDUCTION_RAD  # abduction of the upper arm
    inward_rad: float | F64 = ELBOW_INWARD_RAD  # rotation of the upper arm, elbow bending inward


# Goals of gestures: the forearm in front of the torso, or the hand above the head
GOALS: Mapping[str, ArmAngles] = {
    "before_torso": ArmAngles(38.0, 92.0, 0.10, 1.25),
    "raise": ArmAngles(150.0, 25.0, 0.25, 0.25),
    "wave": ArmAngles(150.0, 25.0, 0.25, 0.25),
    "point": ArmAngles(75.0, 2.0, 0.05, 0.25),
}
WAVE_HZ, WAVE_RAD = 1.5, 0.45  # frequency and amplitude of the abduction of a waving arm


def with_gestures(
    angles: ArmAngles, gestures: Sequence[Gesture], side: int, times_s: F64
) -> ArmAngles:
    """Return the angles of an arm (side 0 left, 1 right) with gestures at T times."""
    for gesture in gestures:
        if gesture.hand == HANDS[side]:
            goal = GOALS[gesture.move]
            if gesture.move == "wave":
                swing_rad = WAVE_RAD * np.sin(2 * np.pi * WAVE_HZ * (times_s - gesture.at_s))
                goal = replace(goal, aside_rad=goal.aside_rad + swing_rad)
            angles = _towards(angles, goal, raised(gesture, times_s))
    return angles


def raised(gesture: Gesture, times_s: F64) -> F64:
    """Return the progress of a gesture: T, 0 at rest, 1 at its goal."""
    up = stance.ease((times_s - gesture.at_s) / gesture.move_s)
    down = stance.ease((gesture.at_s + gesture.for_s - times_s) / gesture.move_s)
    return np.minimum(up, down)


def arm_rotations(angles: ArmAngles, chest: F64, lean_rad: F64, side: int) -> tuple[F64, F64]:
    """Return the rotations of upper arm and forearm, map_from_segment, Tx3x3.

    Args:
        angles: Angles of the arm.
        chest: Tx3x3, map_from_chest.
        lean_rad: Forward lean of the chest, T; arms hang vertically.
        side: 0 left, 1 right.
    """
    upper = (
        chest
        @ about_y(-np.radians(angles.shoulder_deg) - 0.6 * lean_rad)
        @ about_x(SIDES[side] * np.asarray(angles.aside_rad))
        @ about_z(-SIDES[side] * np.asarray(angles.inward_rad))
    )
    return upper, upper @ about_y(-np.radians(angles.elbow_deg))


def _towards(angles: ArmAngles, goal: ArmAngles, part: F64) -> ArmAngles:
    def mixed(now: float | F64, then: float | F64) -> F64:
        return np.asarray(now + (then - now) * part)

    return ArmAngles(
        mixed(angles.shoulder_deg, goal.shoulder_deg),
        mixed(angles.elbow_deg, goal.elbow_deg),
        mixed(angles.aside_rad, goal.aside_rad),
        mixed(angles.inward_rad, goal.inward_rad),
    )


def lacking_height_m(hip_m: F64, ankle_m: F64, skeleton: Skeleton, side: int) -> F64:
    """Return the lowering of the hip with which the leg reaches the ankle [m], T, at least 0."""
    length = REACH * sum(_lengths(skeleton, side))
    aside = np.sum((ankle_m - hip_m)[:, :2] ** 2, axis=-1)
    highest = ankle_m[:, 2] + np.sqrt(np.maximum(length**2 - aside, 0.01))
    return np.asarray(np.maximum(hip_m[:, 2] - highest, 0.0))


def smooth_cover(values: F64) -> F64:
    """Return a smooth upper bound of the values."""
    size = 2 * SMOOTH_STEPS + 1
    cover = maximum_filter1d(values, 2 * size - 1, mode="nearest")
    for _ in range(2):
        cover = uniform_filter1d(cover, size, mode="nearest")
    return np.asarray(cover)


def _lengths(skeleton: Skeleton, side: int) -> tuple[float, float]:
    thigh = skeleton.knee[side] - skeleton.hip[side]
    shank = skeleton.ankle[side] - skeleton.knee[side]
    return float(np.linalg.norm(thigh)), float(np.linalg.norm(shank))


def bend_leg(hip_m: F64, foot: FootPath, forward: F64, skeleton: Skeleton, side: int) -> F64:
    """Return the rotations of thigh and shank that bring the ankle to the foot, 2xTx3x3.

    Args:
        hip_m: Tx3, frame: map.
        foot: Path of the foot.
        forward: Tx3, direction of the knee, frame: map.
        skeleton: Skeleton of the person.
        side: 0 left, 1 right.
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
        [along(knee, lateral) @ rest[0].T, along(axis * distance - knee, lateral) @ rest[1].T]
    )
