"""Comparison of a frame with a keyframe."""

from dataclasses import dataclass

import numpy as np

from people4d.messages import F32, F64
from services.visual_odometry.fit import MotionFit, MotionPrior
from services.visual_odometry.keyframe import Keyframe, PoseEstimate
from services.visual_odometry.reprojection import PLANAR, Flags

# On the standard deviation of a motion as it adds up: errors of keyframes are correlated
DRIFT_FACTOR = 2.5


@dataclass(frozen=True)
class Attempt:
    """A keyframe to compare a frame with."""

    keyframe: Keyframe
    guess_px: F32  # Nx2, predicted pixels of its landmarks
    prior: MotionPrior  # of the motion since


@dataclass(frozen=True)
class Comparison:
    """A keyframe that a frame was compared with, and the motion since."""

    keyframe: Keyframe
    pixels: F32  # Nx2, of its landmarks
    found: Flags  # N, landmarks that were found again
    fit: MotionFit
    overlap: float  # share of its landmarks that were found again and agree

    @property
    def pose(self) -> PoseEstimate:
        """Pose of the base: that of the keyframe, and the motion since."""
        then = self.keyframe.pose
        matrix = then.matrix @ self.fit.before_from_now
        lever = np.eye(3)
        away_m = matrix[:2, 3] - then.matrix[:2, 3]
        lever[:2, 2] = -away_m[1], away_m[0]  # effect of an error of the keyframe's yaw
        own = on_floor(self.fit.covariance + self.fit.common)
        own = DRIFT_FACTOR**2 * rotated_covariance(own, matrix)
        return PoseEstimate(matrix, lever @ then.covariance @ lever.T + own)


def rotated_covariance(covariance: F64, fixed_from_base: F64) -> F64:
    """Return the covariance (3x3) of x, y and yaw in the fixed frame, from that in the base."""
    rotation = np.eye(3)
    rotation[:2, :2] = fixed_from_base[:2, :2]
    return np.asarray(rotation @ covariance @ rotation.T)


def on_floor(covariance: F64) -> F64:
    """Return the entries (3x3) of x, y and yaw of a covariance of a twist (KxK)."""
    return covariance[np.ix_(PLANAR, PLANAR)] if len(covariance) > len(PLANAR) else covariance
