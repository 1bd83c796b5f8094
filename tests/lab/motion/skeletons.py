"""Skeletons from anthropometry, for tests that need no baked body."""

import numpy as np

from lab.bodies.skeleton import Skeleton


def skeleton(stature_m: float = 1.75) -> Skeleton:
    """Return a skeleton with segment lengths of D. A. Winter (Biomechanics and Motor Control of
    Human Movement, figure of body segment lengths), as parts of the stature."""
    h = stature_m
    sides = np.array([1.0, -1.0])

    def pair(x: float, y: float, z: float) -> np.ndarray:
        return np.stack([np.full(2, x), sides * y, np.full(2, z)], axis=-1) * h

    # Hip 0.530, knee 0.285, ankle 0.039 above the floor; the pelvis' origin is between the hips.
    hip, knee, ankle, sole = 0.530, 0.285, 0.045, 0.0
    return Skeleton(
        hip=pair(0.0, 0.050, 0.0),
        knee=pair(0.004, 0.050, knee - hip),
        ankle=pair(-0.010, 0.050, ankle - hip),
        heel=pair(-0.042, 0.050, sole - hip),
        ball=pair(0.070, 0.050, sole - hip),
        toe=pair(0.115, 0.050, sole - hip),
        waist=np.array([0.0, 0.0, 0.10]) * h,
        shoulder=pair(0.0, 0.110, 0.818 - hip),
        elbow=pair(0.0, 0.110, 0.632 - hip),
        wrist=pair(0.0, 0.110, 0.486 - hip),
        stature_m=h,
    )
