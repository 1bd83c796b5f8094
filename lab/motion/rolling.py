"""How a shoe rolls over the floor: over the heel, flat, over the ball, over the tip of the toes."""

from dataclasses import dataclass

import numpy as np

from lab.motion.rotations import about_y, about_z, turn
from lab.posture import Skeleton
from people4d.messages import F64

# The toes stay flat up to this pitch of the foot; then it rolls over their tip. A stiff shoe.
TOE_BEND_RAD, TOE_STIFFENING_RAD = 0.25, 0.1
ROUNDNESS_M = 0.03


@dataclass(frozen=True)
class Shoe:
    """Points of a foot in the neutral posture, 3 each, metres.

    Args:
        heel: From the ankle.
        ball: From the ankle.
        toes: Their tip from the ball, along the floor.
    """

    heel: F64
    ball: F64
    toes: F64

    @classmethod
    def of(cls, skeleton: Skeleton, side: int) -> "Shoe":
        """Return the shoe of a person; side 0 is left, 1 right."""
        ankle, ball = skeleton.ankle[side], skeleton.ball[side]
        toes = (skeleton.toe[side] - ball) * (1.0, 0.0, 0.0)
        return cls(skeleton.heel[side] - ankle, ball - ankle, np.asarray(toes))

    def standing_ankle(self, place: F64, pitch_rad: F64) -> F64:
        """Return the ankle of a foot that rolls where it stands.

        Args:
            place: Tx3, x and y of the ankle and yaw of the flat foot, frame: map.
            pitch_rad: T, toes up.

        Returns:
            Tx3 metres, frame: map.
        """
        pivot = np.where((pitch_rad > 0.0)[:, None], self.heel, self.ball)
        rise = self.toes - turn(about_y(_toe_roll(pitch_rad)), self.toes)  # of the ball
        moved = pivot - turn(about_y(-pitch_rad), pivot) + rise
        ankle = turn(about_z(place[:, 2]), moved)
        ankle[:, :2] += place[:, :2]
        ankle[:, 2] -= pivot[:, 2]
        return ankle

    def ankle_height(self, pitch_rad: F64, swinging: F64) -> F64:
        """Return the height of the ankle at which the sole touches the floor, T.

        Args:
            pitch_rad: T, toes up.
            swinging: T, 0 standing to 1 in mid-swing. In the swing heel and ball change roles
                while the foot turns: rounded, not with a kink.
        """
        heel, ball = (turn(about_y(-pitch_rad), point)[:, 2] for point in (self.heel, self.ball))
        half = np.hypot((heel - ball) / 2.0, 1e-6 + ROUNDNESS_M * swinging)
        rise = np.sin(_toe_roll(pitch_rad)) * self.toes[0]
        return np.asarray(rise - (heel + ball) / 2.0 + half)


def _toe_roll(pitch_rad: F64) -> F64:
    """Return how far the toes are lifted off the floor when they bend no further, radians."""
    over = (-pitch_rad - TOE_BEND_RAD) / TOE_STIFFENING_RAD
    return np.asarray(TOE_STIFFENING_RAD * np.logaddexp(0.0, over))
