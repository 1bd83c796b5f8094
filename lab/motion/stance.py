"""Motions without walking: standing, looking around and sitting."""

from dataclasses import dataclass

import numpy as np

from lab.motion.walker import SEAT_BEHIND, SEAT_HEIGHT_M
from people4d.messages import F64

SWAY_KEY, GAZE_KEY = 7101, 7102

# Frequencies [Hz] and amplitudes [m] of postural sway: mostly below 0.5 Hz, about 5 mm forward and
# backward and 3 mm sideways [Winter 1995]
SWAY_HZ = np.array([0.07, 0.13, 0.23, 0.37, 0.61])
SWAY_M = np.array([0.0040, 0.0030, 0.0022, 0.0014, 0.0008])
SIDEWAYS = 0.6  # ratio of sideways to forward sway
BREATH_HZ, BREATH_RAD = 0.25, 0.006

# Arm angles with the hands on the thighs [deg]
RESTING_SHOULDER_DEG, RESTING_ELBOW_DEG = 14.0, 48.0
GAZE_RAD = 0.95  # maximum yaw of the head in looking around [rad]
HIP_ABOVE_SEAT = 0.050  # height of the hip joints above the seat, relative to the stature


@dataclass(frozen=True)
class Sitting:
    """A person between standing (all 0) and sitting; arrays are T long."""

    back_m: F64  # displacement of the pelvis backward from standing
    low: F64  # height of the hips: 0 standing, 1 on the seat
    pelvis_rad: F64  # forward tilt of the pelvis
    chest_rad: F64  # forward lean of the chest in the room
    rest: F64  # 0 arms hang, 1 hands on the thighs


def ease(part: F64) -> F64:
    """Return the minimum-jerk path from 0 to 1 [Flash 1985]."""
    part = np.clip(part, 0.0, 1.0)
    return np.asarray(part**3 * (10.0 - 15.0 * part + 6.0 * part**2))


def seated_height_m(stature_m: float) -> float:
    """Return the height of the hip joints of a seated person."""
    return SEAT_HEIGHT_M + HIP_ABOVE_SEAT * stature_m


def sit(seated: F64, stature_m: float) -> Sitting:
    """Return the state of a person of a stature [m] at T progresses, 0 standing to 1 seated.

    The torso leans forward, most at seat-off, to keep the weight of the body above the feet
    [Schenkman 1990].
    """
    low = ease((seated - 0.1) / 0.75)
    lean = np.sin(np.pi * ease(seated)) ** 2
    settled = ease((seated - 0.5) / 0.5)
    return Sitting(
        back_m=SEAT_BEHIND * stature_m * low,
        low=low,
        pelvis_rad=0.45 * lean - 0.15 * settled,
        chest_rad=0.65 * lean + 0.05 * settled,
        rest=settled,
    )


def sway(times_s: F64, seed: int, index: int) -> F64:
    """Return the displacement of the pelvis of a standing person [m]: Tx2, forward and left."""
    phase = np.random.default_rng([seed, SWAY_KEY, index]).uniform(0, 2 * np.pi, (2, len(SWAY_HZ)))
    angle = 2 * np.pi * SWAY_HZ * times_s[:, None, None] + phase
    both = np.sum(SWAY_M * np.sin(angle), axis=-1)
    return np.asarray(both * (1.0, SIDEWAYS))


def breath(times_s: F64) -> F64:
    """Return the lean of the chest by breathing [rad], T."""
    return np.asarray(BREATH_RAD * np.sin(2 * np.pi * BREATH_HZ * times_s))


def gaze_around(times_s: F64, seed: int, index: int) -> F64:
    """Return the gaze of looking around [rad], T, positive to the left."""
    phase = np.random.default_rng([seed, GAZE_KEY, index]).uniform(0, 2 * np.pi, 3)
    # Three slow, flattened waves: the gaze rests at either side.
    angle = 2 * np.pi * np.array([0.11, 0.19, 0.31]) * times_s[:, None] + phase
    return np.asarray(GAZE_RAD * np.tanh(1.6 * np.sin(angle) @ np.array([0.6, 0.5, 0.3])))
