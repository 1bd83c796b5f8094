"""Fields of view: the image and the depth range of cameras."""

from collections.abc import Sequence

import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import apply, deproject, project
from common.metrics.record import BOOL
from people4d.messages import F64, CameraInfo
from people4d.messages.base import MAX_CAMERAS

NEAR_M = 1e-3  # [m] minimum depth of a point with a pixel
MAX_REPROJECTION = 0.01  # [m/m] maximum error of a point from its pixel, per metre of depth


class CameraViews:
    """Fields of view of all cameras; the caller fills the transform buffer."""

    def __init__(self, transforms: TransformBuffer) -> None:
        self._transforms = transforms
        self._infos: dict[str, CameraInfo] = {}

    def add_camera(self, info: CameraInfo) -> None:
        """Store the calibration of a camera."""
        if info.camera in self._infos or len(self._infos) < MAX_CAMERAS:
            self._infos[info.camera] = info

    def outside(self, positions_m: Sequence[F64], frame_id: str, stamp_ns: int) -> BOOL | None:
        """Return flags (N) of positions (N of 3 in a frame) outside of the view of every camera.

        None if at that time the pose of no camera is known.
        """
        views = []
        for info in self._infos.values():
            pose = self._transforms.lookup(info.frame_id, frame_id, stamp_ns)
            if pose is not None:
                views.append(in_view(np.array(positions_m), pose.matrix, info))
        return np.asarray(~np.any(views, axis=0)) if views else None


def in_view(points_m: F64, camera_from_map: F64, info: CameraInfo) -> BOOL:
    """Return flags (N) of the points in the image and in the range of depth, occluded or not.

    Points are Nx3, for example torsos in the map; the transform (4x4) is to the optical frame.
    """
    points = apply(camera_from_map, np.reshape(points_m, (-1, 3)))
    inside: BOOL = (points[:, 2] > NEAR_M) & (points[:, 2] <= info.max_depth_m)
    rows = np.flatnonzero(inside)
    with np.errstate(all="ignore"):  # an implausible lens gives infinite pixels, which are outside
        pixels = project(points[rows], info)
        last = (info.width - 1, info.height - 1)
        inside[rows] = np.all((pixels >= 0) & (pixels <= last), axis=1)
        if info.distortion:
            inside[rows] &= _reprojects(pixels, points[rows], info)
    return inside


def _reprojects(pixels: F64, points: F64, info: CameraInfo) -> BOOL:
    """Check that a pixel reprojects to its point: lenses may bend rays from outside inwards."""
    apart_m = np.linalg.norm(deproject(pixels, points[:, 2], info) - points, axis=1)
    return np.asarray(apart_m <= MAX_REPROJECTION * points[:, 2])
