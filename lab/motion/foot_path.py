"""Motion of a foot in its stances and swings; the shoe rolls over heel, ball and toes."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lab.bodies.rotations import about_y, about_z, turn
from lab.bodies.skeleton import Skeleton
from lab.motion.footfalls import FootStances
from lab.motion.gait import LIFT_OFF, gait_curve
from people4d.messages import F64

FLAT = 0.25  # phase at which the whole sole is on the floor
IN_AIR = 1.0 - LIFT_OFF  # share of the swing in the cycle
REFERENCE_STRIDE_M = 1.40  # stride of the pitch curve [m]
PITCH_SHARES = (0.3, 1.1)  # minimum and maximum factor of the pitch curve
CLEARANCE_M = 0.03  # height of the lowest point of the sole in early swing [m]
LANDING = 3.0  # steepness of the landing of the heel, relative to the clearance
PUSH_SHARE = 0.4  # velocity added by push-off, relative to the swing's mean velocity
# Pitch up to which the toes of a stiff shoe stay flat, and width of the transition [rad]
TOE_BEND_RAD, TOE_STIFFENING_RAD = 0.25, 0.1
ROUNDNESS_M = 0.03  # smoothing of the change between heel and ball in the swing [m]


@dataclass(frozen=True)
class Shoe:
    """Points of a foot in the neutral pose [m], 3 each."""

    heel: F64  # relative to the ankle
    ball: F64  # relative to the ankle
    toes: F64  # tip relative to the ball, along the floor

    @classmethod
    def from_skeleton(cls, skeleton: Skeleton, side: int) -> "Shoe":
        """Return the shoe of a person; side 0 left, 1 right."""
        ankle, ball = skeleton.ankle[side], skeleton.ball[side]
        toes = (skeleton.toe[side] - ball) * (1.0, 0.0, 0.0)
        return cls(skeleton.heel[side] - ankle, ball - ankle, np.asarray(toes))

    def standing_ankle(self, footprint: F64, pitch_rad: F64) -> F64:
        """Return the ankle of a foot that rolls on its footprint [m], Tx3, frame: map.

        Args:
            footprint: Tx3, x and y of the ankle and yaw of the flat foot, frame: map.
            pitch_rad: T, toes up.
        """
        pivot = np.where((pitch_rad > 0.0)[:, None], self.heel, self.ball)
        rise = self.toes - turn(about_y(_toe_roll(pitch_rad)), self.toes)  # rise of the ball
        moved = pivot - turn(about_y(-pitch_rad), pivot) + rise
        ankle = turn(about_z(footprint[:, 2]), moved)
        ankle[:, :2] += footprint[:, :2]
        ankle[:, 2] -= pivot[:, 2]
        return ankle

    def ankle_height(self, pitch_rad: F64, swinging: F64) -> F64:
        """Return the height of the ankle at which the sole touches the floor [m], T.

        Args:
            pitch_rad: T, toes up.
            swinging: T, 0 standing to 1 in mid-swing. The change of the lowest point from heel to
                ball is smooth in the swing.
        """
        heel, ball = (turn(about_y(-pitch_rad), point)[:, 2] for point in (self.heel, self.ball))
        half = np.hypot((heel - ball) / 2.0, 1e-6 + ROUNDNESS_M * swinging)
        rise = np.sin(_toe_roll(pitch_rad)) * self.toes[0]
        return np.asarray(rise - (heel + ball) / 2.0 + half)


def _toe_roll(pitch_rad: F64) -> F64:
    """Return the maximum pitch of the toes [rad]."""
    over = (-pitch_rad - TOE_BEND_RAD) / TOE_STIFFENING_RAD
    return np.asarray(TOE_STIFFENING_RAD * np.logaddexp(0.0, over))


@dataclass(frozen=True)
class FootPath:
    """Motion of one foot over time."""

    ankle_m: F64  # Tx3, frame: map
    map_from_foot: F64  # Tx3x3


@dataclass(frozen=True)
class FootPhases:
    """Progress of a foot in its stances and swings; arrays are T long."""

    stance: npt.NDArray[np.intp]  # number of the stance, or of the stance before the swing
    swing: F64  # completed share of the swing, 0 while standing
    contact: F64  # phase since heel contact, up to FLAT
    push: F64  # phase towards lift-off, from FLAT


def foot_path(feet: FootStances, skeleton: Skeleton, side: int, times_s: F64) -> FootPath:
    """Return the motion of a foot: heel contact, flat stance, roll about the ball, swing."""
    shoe, rhythm = Shoe.from_skeleton(skeleton, side), _rhythm(feet, times_s)
    stride = np.linalg.norm(np.diff(feet.footprint[:, :2], axis=0), axis=-1)
    share = np.clip(stride / REFERENCE_STRIDE_M, *PITCH_SHARES)
    pitch = _pitch(rhythm, share)
    ankle = shoe.standing_ankle(feet.footprint[rhythm.stance], pitch)
    yaw = feet.footprint[rhythm.stance, 2]
    swinging = rhythm.swing > 0.0
    if swinging.any():
        number, part = rhythm.stance[swinging], rhythm.swing[swinging]
        ankle[swinging, :2] = _swing_ankle(feet, shoe, share, number, part)
        height = shoe.ankle_height(pitch[swinging], np.sin(np.pi * part) ** 2)
        ankle[swinging, 2] = height + _clearance_m(part) * np.minimum(share[number], 1.0)
        turned = np.diff(feet.footprint[:, 2])[number]
        yaw[swinging] += part * part * (3.0 - 2.0 * part) * turned
    return FootPath(ankle, about_z(yaw) @ about_y(-pitch))


def _rhythm(feet: FootStances, times_s: F64) -> FootPhases:
    stance = np.clip(np.searchsorted(feet.down_s, times_s, side="right") - 1, 0, None)
    swing_s = np.maximum(feet.down_s[1:] - feet.up_s[:-1], 1e-3)
    # Phases of a stance scale with the swings before and after it. The first stance follows no
    # swing and the last precedes none; both are longer than any phase.
    before_s, after_s = np.append(1.0, swing_s)[stance], np.append(swing_s, 1.0)[stance]
    return FootPhases(
        stance,
        swing=np.clip((times_s - feet.up_s[stance]) / after_s, 0.0, 1.0),
        contact=np.clip((times_s - feet.down_s[stance]) / before_s * IN_AIR, 0.0, FLAT),
        push=np.clip(LIFT_OFF - (feet.up_s[stance] - times_s) / after_s * IN_AIR, FLAT, LIFT_OFF),
    )


def _pitch(rhythm: FootPhases, share: F64) -> F64:
    """Return the pitch of the foot, toes up [rad], T; larger in longer strides."""
    before, after = np.append(0.0, share)[rhythm.stance], np.append(share, 0.0)[rhythm.stance]
    standing = before * gait_curve("foot.pitch_deg", rhythm.contact)
    standing += after * gait_curve("foot.pitch_deg", rhythm.push)
    swinging = after * gait_curve("foot.pitch_deg", LIFT_OFF + IN_AIR * rhythm.swing)
    return np.asarray(np.radians(np.where(rhythm.swing > 0.0, swinging, standing)))


def _clearance_m(part: F64) -> F64:
    high_early = np.sin(np.pi * part**0.6) ** 2
    return np.asarray(CLEARANCE_M * (high_early + LANDING * part**2 * (1.0 - part)))


def _swing_ankle(
    feet: FootStances, shoe: Shoe, share: F64, number: npt.NDArray[np.intp], part: F64
) -> F64:
    """Return the ankle in swings (x and y [m], frame: map) by cubic interpolation.

    Args:
        feet: Stances of the foot.
        shoe: Shape of the foot.
        share: Factors of the pitch curve, one for each swing.
        number: Numbers of the swings, T.
        part: Completed shares of these swings, T.
    """

    def ankles(footprint: F64, phase: float) -> F64:
        pitch = np.radians(share * gait_curve("foot.pitch_deg", phase))
        return shoe.standing_ankle(footprint, pitch)[:, :2]

    step, s = 0.005, part[:, None]  # difference of phase, into the stance
    before, after = feet.footprint[:-1], feet.footprint[1:]
    leave, meet = ankles(before, LIFT_OFF), ankles(after, 0.0)
    leave_rate = (leave - ankles(before, LIFT_OFF - step)) * (IN_AIR / step)
    leave_rate = leave_rate + PUSH_SHARE * (meet - leave)
    meet_rate = (ankles(after, step) - meet) * (IN_AIR / step)
    return np.asarray(
        (2 * s**3 - 3 * s**2 + 1) * leave[number]
        + (s**3 - 2 * s**2 + s) * leave_rate[number]
        + (3 * s**2 - 2 * s**3) * meet[number]
        + (s**3 - s**2) * meet_rate[number]
    )
