"""Whom a camera can see at all: within the image and the range of its depth."""

import numpy as np

from common.geometry.transforms import apply, deproject, project
from common.metrics.record import BOOL
from people4d.messages import F64, CameraInfo

NEAR_M = 1e-3  # [m] what is nearer along the axis, or behind, has no pixel
SAME = 0.01  # [m] per metre of depth: so near a pixel must lead back to its point


def in_view(points_m: F64, camera_from_map: F64, info: CameraInfo) -> BOOL:
    """Tell which points lie in the image and in the range of depth; what hides them is not known.

    Args:
        points_m: Nx3, for example torsos, frame: map.
        camera_from_map: 4x4, to the optical frame.
        info: Calibration and depth range.

    Returns:
        N, True inside.
    """
    points = apply(camera_from_map, np.reshape(points_m, (-1, 3)))
    inside: BOOL = (points[:, 2] > NEAR_M) & (points[:, 2] <= info.max_depth_m)
    rows = np.flatnonzero(inside)
    with np.errstate(all="ignore"):  # an absurd lens gives infinite pixels, which are outside
        pixels = project(points[rows], info)
        last = (info.width - 1, info.height - 1)
        inside[rows] = np.all((pixels >= 0) & (pixels <= last), axis=1)
        if info.distortion:
            inside[rows] &= _lead_back(pixels, points[rows], info)
    return inside


def _lead_back(pixels: F64, points: F64, info: CameraInfo) -> BOOL:
    """Tell where a pixel leads back to its point: far outside, lenses may bend rays inside."""
    apart_m = np.linalg.norm(deproject(pixels, points[:, 2], info) - points, axis=1)
    return np.asarray(apart_m <= SAME * points[:, 2])
