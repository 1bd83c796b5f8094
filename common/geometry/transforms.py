"""Frames, the pinhole camera and angles (docs/method.md section 1).

Optical frames: x right, y down, z forward. Body frames (camera_link, map): x forward, y left, z up.
Transforms are 4x4 and named target_from_source.
"""

import math

import cv2
import numpy as np
import numpy.typing as npt

from people4d.messages import F64, CameraInfo

LINK_FROM_OPTICAL: F64 = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)

# OpenCV's default of five iterations leaves 0.07 px at the rim of a wide lens.
UNDISTORT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)


def wrap(angle_rad: float) -> float:
    """Wrap an angle to (-pi, pi]."""
    wrapped = math.pi - (math.pi - angle_rad) % (2 * math.pi)
    # The remainder of a tiny negative number rounds up to a full turn.
    return wrapped if wrapped > -math.pi else math.pi


def wrap_each(angles_rad: F64) -> F64:
    """Wrap angles to [-pi, pi]; the result may be either end."""
    return angles_rad - 2 * math.pi * np.rint(angles_rad / (2 * math.pi))


def camera_matrix(info: CameraInfo) -> F64:
    """Return the 3x3 matrix of a calibration."""
    return np.array([[info.fx, 0.0, info.cx], [0.0, info.fy, info.cy], [0.0, 0.0, 1.0]])


def deproject(pixels: npt.ArrayLike, depth_m: npt.ArrayLike, info: CameraInfo) -> F64:
    """Return the 3D points behind pixels, lens distortion removed.

    Args:
        pixels: Nx2, u and v in pixels.
        depth_m: N, distance along the optical axis in metres.
        info: Calibration.

    Returns:
        Nx3 points in metres, optical frame.
    """
    uv = np.asarray(pixels, np.float64).reshape(-1, 2)
    z = np.asarray(depth_m, np.float64).reshape(-1)
    if info.distortion and len(uv):
        coefficients = np.array(info.distortion)
        rays = cv2.undistortPoints(
            uv[:, None], camera_matrix(info), coefficients, criteria=UNDISTORT
        )[:, 0]
    else:
        rays = (uv - (info.cx, info.cy)) / (info.fx, info.fy)
    points_m = np.empty((len(z), 3))
    np.multiply(rays, z[:, None], out=points_m[:, :2])
    points_m[:, 2] = z
    return points_m


def project(points_m: npt.ArrayLike, info: CameraInfo) -> F64:
    """Return the pixels of points, lens distortion applied.

    Args:
        points_m: Nx3 in metres, optical frame, in front of the camera.
        info: Calibration.

    Returns:
        Nx2, u and v in pixels.
    """
    points = np.asarray(points_m, np.float64).reshape(-1, 3)
    if info.distortion and len(points):
        pixels, _ = cv2.projectPoints(
            points, np.zeros(3), np.zeros(3), camera_matrix(info), np.array(info.distortion)
        )
        return np.asarray(pixels[:, 0], np.float64)
    return points[:, :2] / points[:, 2:] * (info.fx, info.fy) + (info.cx, info.cy)


def transform_from(translation_m: npt.ArrayLike, rotation: npt.ArrayLike) -> F64:
    """Return the 4x4 transform of a translation (3) and a rotation matrix (3x3)."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation_m
    return matrix


def rotation_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> F64:
    """Return Rz(yaw) Ry(pitch) Rx(roll), the fixed-axis convention of ROS."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def apply(matrix: F64, points_m: npt.ArrayLike) -> F64:
    """Transform points (Nx3 or 3) from the source frame to the target frame of a 4x4."""
    points = np.asarray(points_m, np.float64)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def invert(matrix: F64) -> F64:
    """Return source_from_target of a rigid target_from_source."""
    rotation = matrix[:3, :3].T
    return transform_from(-rotation @ matrix[:3, 3], rotation)
