"""How people hold their arms: they swing in walking, rest in sitting, and make gestures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lab.motion import stance
from lab.motion.footfalls import SIDES
from lab.motion.rotations import about_x, about_y, about_z
from lab.scenario import Gesture
from people4d.messages import F64

HANDS = ("left", "right")
ABDUCTION_RAD, ELBOW_INWARD_RAD = 0.13, 0.25


@dataclass(frozen=True)
class ArmAngles:
    """The joints of one arm, T long or the same at all times.

    Args:
        shoulder_deg: Forward from hanging.
        elbow_deg: Bent from straight.
        aside_rad: Of the upper arm, away from the body.
        inward_rad: By which the upper arm is turned about itself, so that the elbow bends inward.
    """

    shoulder_deg: float | F64
    elbow_deg: float | F64
    aside_rad: float | F64 = ABDUCTION_RAD
    inward_rad: float | F64 = ELBOW_INWARD_RAD


# The forearm lies across the trunk, the hand a hand's breadth before it; or the hand is held high.
GOALS: Mapping[str, ArmAngles] = {
    "before_torso": ArmAngles(38.0, 92.0, 0.10, 1.25),
    "raise": ArmAngles(150.0, 25.0, 0.25, 0.25),
}


def with_gestures(
    angles: ArmAngles, gestures: Sequence[Gesture], side: int, times_s: F64
) -> ArmAngles:
    """Return the joints of an arm with its owner's gestures.

    Args:
        angles: Without them.
        gestures: Of both arms.
        side: 0 left, 1 right.
        times_s: T.
    """
    for gesture in gestures:
        if gesture.hand == HANDS[side]:
            angles = _towards(angles, GOALS[gesture.move], raised(gesture, times_s))
    return angles


def raised(gesture: Gesture, times_s: F64) -> F64:
    """Return how far a gesture is done: T, 0 the arm as ever, 1 where the gesture takes it."""
    up = stance.ease((times_s - gesture.at_s) / gesture.move_s)
    down = stance.ease((gesture.at_s + gesture.for_s - times_s) / gesture.move_s)
    return np.minimum(up, down)


def arm_rotations(angles: ArmAngles, chest: F64, lean_rad: F64, side: int) -> tuple[F64, F64]:
    """Return the rotations of upper arm and forearm, map_from_segment, Tx3x3.

    Args:
        angles: Of the joints.
        chest: Tx3x3, map_from_chest.
        lean_rad: T, of the chest forward; it leaves the arms hanging.
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
