"""Motion of a person in a wheelchair: a seated pose that rolls along the path."""

import numpy as np

from lab.bodies.rotations import about_z
from lab.furniture import FOOTREST_M
from lab.motion.bouts import WalkPath
from lab.motion.footfalls import Individual, StepPlan
from lab.motion.kinematics import pose_arrays
from lab.motion.walker import SEAT_BEHIND
from people4d.messages import F64


def roll(person: Individual, path: WalkPath, looking: F64) -> tuple[F64, F64, StepPlan]:
    """Return a seated person's pose at all times of a path, without steps, see `pose_arrays`.

    The hips are above the path.

    Args:
        person: Person with individual differences.
        path: Path of the wheelchair.
        looking: T, 1 while looking around.
    """
    zero = np.zeros(len(path.times_s))
    rest = WalkPath(path.times_s, zero, zero, zero, zero, zero)
    pelvis_m, rotations, steps = pose_arrays(person, rest, zero + 1.0, looking)
    turned = about_z(path.yaw_rad)
    pelvis_m += (SEAT_BEHIND * person.skeleton.stature_m, 0.0, FOOTREST_M)
    pelvis_m = np.einsum("tij,tj->ti", turned, pelvis_m)
    pelvis_m[:, 0] += path.x_m
    pelvis_m[:, 1] += path.y_m
    rotations[:, 0] = turned @ rotations[:, 0]
    return pelvis_m, rotations, steps
