"""Kinematics of all segments: pelvis, torso and arms by the gait curves, legs by the feet."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from lab.bodies.rotations import about_x, about_y, about_z, turn
from lab.bodies.skeleton import INDEX, PARENTS, SEGMENTS, Skeleton
from lab.motion import stance
from lab.motion.acts import perform
from lab.motion.bouts import WalkPath
from lab.motion.foot_path import FootPath, foot_path
from lab.motion.footfalls import Individual, StepPlan, plan_steps
from lab.motion.gait import REFERENCE_MPS, gait_curve, step_length_m
from lab.motion.limbs import (
    ArmAngles,
    arm_rotations,
    bend_leg,
    lacking_height_m,
    smooth_cover,
    with_gestures,
)
from lab.motion.walker import STEP_S
from people4d.messages import F64

BLEND_S = 0.2  # duration of the transition between walking and standing [s]
STAND_LOW_M = 0.005  # drop of the standing pelvis below straight legs [m]
WALK_LOW_M = 0.022  # mean drop of the pelvis below its standing height at 1.3 m/s [m]
ANTICIPATION_S = 0.5  # look-ahead of the head along the path [s]
GAZE_MAX_RAD = 0.7  # maximum yaw of the head ahead of the path [rad]
GAZE_OF_CHEST = 0.25  # ratio of chest yaw to head yaw in looking around
HANGING_ELBOW_DEG, HANGING_SHOULDER_DEG = 14.0, 0.0


@dataclass(frozen=True)
class GaitScaling:
    """Scaling of the gait curves; arrays are T long."""

    times_s: F64  # times of the path
    phase: F64  # cycles of the left leg
    stepping: F64  # 0 standing to 1 stepping
    stride: F64  # step length relative to the curves
    speed: F64  # speed relative to the curves


@dataclass(frozen=True)
class TorsoMotion:
    """Pelvis, chest and head; positions Tx3 and rotations Tx3x3, frame: map."""

    pelvis_m: F64
    pelvis: F64
    chest: F64
    head: F64


def pose_arrays(
    person: Individual, path: WalkPath, seated: F64, looking: F64
) -> tuple[F64, F64, StepPlan]:
    """Return a person's pose at all times of a path.

    Args:
        person: Person with individual differences.
        path: Path over the floor.
        seated: T, progress of sitting down, 0 to 1.
        looking: T, 1 while looking around.

    Returns:
        Positions of the pelvis [m], Tx3, frame: map; rotations parent_from_segment, Tx13x3x3, the
        first map_from_pelvis; the steps.
    """
    steps = plan_steps(path, person)
    scaling = _gait_scaling(path, steps, person)
    sitting = stance.sit(seated, person.skeleton.stature_m)
    feet = [foot_path(steps.feet[side], person.skeleton, side, path.times_s) for side in (0, 1)]
    torso = _torso_motion(person, path, scaling, sitting, looking)
    torso.pelvis_m[:, 2] -= smooth_cover(_lacking(person.skeleton, torso, feet))
    rotations = np.empty((len(path.times_s), len(SEGMENTS), 3, 3))
    for name, rotation in (("pelvis", torso.pelvis), ("chest", torso.chest), ("head", torso.head)):
        rotations[:, INDEX[name]] = rotation
    for side, end in enumerate("lr"):
        arm = _arm(person, scaling, sitting, torso, side)
        rotations[:, INDEX[f"upper_arm_{end}"]], rotations[:, INDEX[f"forearm_{end}"]] = arm
        leg = _leg(person.skeleton, path, torso, feet[side], side)
        rotations[:, INDEX[f"thigh_{end}"]], rotations[:, INDEX[f"shank_{end}"]] = leg
        rotations[:, INDEX[f"foot_{end}"]] = feet[side].map_from_foot
    perform(person, path, torso.pelvis_m, rotations)
    return torso.pelvis_m, _from_parents(rotations), steps


def _gait_scaling(path: WalkPath, steps: StepPlan, person: Individual) -> GaitScaling:
    soft = BLEND_S / STEP_S
    speed = gaussian_filter1d(path.speed_mps, soft, mode="nearest")
    stature_m = person.skeleton.stature_m
    stepping = gaussian_filter1d(steps.stepping, soft, mode="nearest")
    stride = step_length_m(speed, stature_m) / step_length_m(REFERENCE_MPS, stature_m)
    phase = gaussian_filter1d(steps.phase, soft / 2, mode="nearest")
    return GaitScaling(
        path.times_s, phase, stepping, stride * stepping, speed / REFERENCE_MPS * stepping
    )


def _torso_motion(
    person: Individual, path: WalkPath, scaling: GaitScaling, sitting: stance.Sitting, looking: F64
) -> TorsoMotion:
    """Return pelvis, chest and head before the pelvis is lowered to reach the feet."""
    lean = _curve("chest.pitch", scaling) * np.minimum(scaling.stride, 1.0) + sitting.chest_rad
    lean += stance.breath(path.times_s) * (1.0 - scaling.stepping)
    gaze = _gaze(person, path, looking)
    pelvis = (
        about_z(path.yaw_rad + _curve("pelvis.turn", scaling) * scaling.stride)
        @ about_y(_curve("pelvis.tilt", scaling) * scaling.stride + sitting.pelvis_rad)
        @ about_x(_curve("pelvis.list", scaling) * scaling.stride)
    )
    chest = (
        about_z(
            path.yaw_rad + _curve("chest.turn", scaling) * scaling.stride + GAZE_OF_CHEST * gaze
        )
        @ about_y(lean)
        @ about_x(_curve("chest.list", scaling) * scaling.stride)
    )
    head = about_z(path.yaw_rad + gaze) @ about_y(0.3 * lean + 0.03)
    return TorsoMotion(_pelvis_position(person, path, scaling, sitting), pelvis, chest, head)


def _curve(name: str, scaling: GaitScaling) -> F64:
    return np.asarray(np.radians(gait_curve(f"{name}_deg", scaling.phase)))


def _pelvis_position(
    person: Individual, path: WalkPath, scaling: GaitScaling, sitting: stance.Sitting
) -> F64:
    skeleton = person.skeleton
    still = (1.0 - scaling.stepping) * (1.0 - sitting.low)
    sway = stance.sway(path.times_s, person.seed, person.index) * still[:, None]
    bounce = scaling.stride**2  # the height of an arc grows with the square of its chord
    ahead = gait_curve("pelvis.ahead_m", scaling.phase) * bounce + sway[:, 0] - sitting.back_m
    left = gait_curve("pelvis.left_m", scaling.phase) * scaling.stepping + sway[:, 1]
    sole_m = float(np.min([skeleton.heel[:, 2], skeleton.ball[:, 2]]))
    upright = gait_curve("pelvis.up_m", scaling.phase) * bounce
    upright += -sole_m - STAND_LOW_M - WALK_LOW_M * bounce
    seat_m = stance.seated_height_m(skeleton.stature_m)
    cos, sin = np.cos(path.yaw_rad), np.sin(path.yaw_rad)
    return np.stack(
        [
            path.x_m + cos * ahead - sin * left,
            path.y_m + sin * ahead + cos * left,
            upright + (seat_m - upright) * sitting.low,
        ],
        axis=-1,
    )


def _gaze(person: Individual, path: WalkPath, looking: F64) -> F64:
    """Return the yaw of the head relative to the path: T, radians to the left."""
    later = np.interp(path.times_s + ANTICIPATION_S, path.times_s, path.yaw_rad)
    ahead = GAZE_MAX_RAD * np.tanh((later - path.yaw_rad) / GAZE_MAX_RAD)
    around = stance.gaze_around(path.times_s, person.seed, person.index)
    around *= gaussian_filter1d(looking, 0.3 / STEP_S, mode="nearest")
    return np.asarray(gaussian_filter1d(ahead, 0.1 / STEP_S, mode="nearest") + around)


def _lacking(skeleton: Skeleton, torso: TorsoMotion, feet: list[FootPath]) -> F64:
    """Return the lowering of the pelvis with which both legs reach their feet [m], T."""
    lacks = [
        lacking_height_m(
            torso.pelvis_m + turn(torso.pelvis, skeleton.hip[side]),
            feet[side].ankle_m,
            skeleton,
            side,
        )
        for side in (0, 1)
    ]
    return np.maximum(lacks[0], lacks[1])


def _arm(
    person: Individual, scaling: GaitScaling, sitting: stance.Sitting, torso: TorsoMotion, side: int
) -> tuple[F64, F64]:
    phase = scaling.phase + 0.5 * side
    swing = scaling.speed * person.arm_swing
    # The arm swings about its hanging position, and bends more at higher speed.
    shoulder = HANGING_SHOULDER_DEG + gait_curve("arm.shoulder_deg", phase) * swing
    elbow = gait_curve("arm.elbow_deg", phase) - HANGING_ELBOW_DEG
    elbow = HANGING_ELBOW_DEG + elbow * np.minimum(swing, 1.2)
    shoulder = shoulder + (stance.RESTING_SHOULDER_DEG - shoulder) * sitting.rest
    elbow = elbow + (stance.RESTING_ELBOW_DEG - elbow) * sitting.rest
    angles = with_gestures(ArmAngles(shoulder, elbow), person.plan.gestures, side, scaling.times_s)
    # Arms hang vertically from a leaning chest.
    lean = np.arctan2(-torso.chest[:, 2, 0], torso.chest[:, 2, 2])
    return arm_rotations(angles, torso.chest, lean, side)


def _leg(skeleton: Skeleton, path: WalkPath, torso: TorsoMotion, foot: FootPath, side: int) -> F64:
    toes = foot.map_from_foot[:, :, 0] * (1.0, 1.0, 0.0)
    toes /= np.linalg.norm(toes, axis=-1, keepdims=True)
    ahead = np.stack(
        [np.cos(path.yaw_rad), np.sin(path.yaw_rad), np.zeros_like(path.yaw_rad)], axis=-1
    )
    hip_m = torso.pelvis_m + turn(torso.pelvis, skeleton.hip[side])
    return bend_leg(hip_m, foot, toes + ahead, skeleton, side)


def _from_parents(rotations: F64) -> F64:
    """Convert map_from_segment, Tx13x3x3, to parent_from_segment; the pelvis is unchanged."""
    relative = rotations.copy()
    for name, parent in PARENTS.items():
        if parent:
            before = np.swapaxes(rotations[:, INDEX[parent]], -1, -2)
            relative[:, INDEX[name]] = before @ rotations[:, INDEX[name]]
    return relative
