"""Angles about the vertical of the camera (docs/method.md section 6).

Angles are taken in the camera's body frame: x forward along the optical axis, y left, z up. 0 is
facing away along the axis, pi facing the camera, +pi/2 facing image-left. Its unit vector in the
optical frame is published, since any transform rotates a vector, but an angle requires the same
axis.
"""

import math
from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F32, F64, CameraInfo

NOSE, LEFT_EYE, RIGHT_EYE, LEFT_EAR, RIGHT_EAR = 0, 1, 2, 3, 4  # COCO
LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_HIP, RIGHT_HIP = 5, 6, 11, 12
SHOULDERS, HIPS = (LEFT_SHOULDER, RIGHT_SHOULDER), (LEFT_HIP, RIGHT_HIP)


@dataclass(frozen=True, slots=True)
class YawEstimate:
    """Measured angle in the camera's body frame."""

    rad: float  # [rad] in (-pi, pi]
    sigma_rad: float  # [rad] standard deviation


def confident_pixels(keypoints: F32, confidence_min: float) -> F64:
    """Return u and v of keypoints (...x17x3), ...x17x2, NaN where the confidence is too low."""
    confident = keypoints[..., 2:] > confidence_min
    return np.where(confident, keypoints[..., :2].astype(np.float64), np.nan)


def bearings(pixels: F64, info: CameraInfo) -> F64:
    """Return the bearings of N torsos [rad], 0 = optical axis, + to the left.

    Pixels (Nx17x2) are NaN where unknown.
    """
    torsos = pixels[:, [*SHOULDERS, *HIPS]]
    known = np.isfinite(torsos[..., 0])
    total_px = np.where(known[..., None], torsos, 0.0).sum(axis=1)
    count = known.sum(axis=1)
    x, _, z = deproject(total_px / np.maximum(count, 1)[:, None], np.ones(len(pixels)), info).T
    return np.where(count > 0, np.arctan2(-x, z), 0.0)


def heading_vector(yaw_rad: float) -> F64:
    """Return the unit vector (3, optical frame) of an angle in the camera's body frame.

    It is d (eq. 4.12) rotated about the camera's upward axis. If d is level, the horizontal part of
    that vector has the person's direction at any tilt and roll of the camera: the tilt adds a
    vertical part only. psi_2 ignores tilt: from 20 deg above, the torso appears 6 % shorter, which
    costs about 2 deg in general and up to 20 deg near 0 and pi, where arccos is steep.
    """
    return np.array([-math.sin(yaw_rad), 0.0, math.cos(yaw_rad)])
