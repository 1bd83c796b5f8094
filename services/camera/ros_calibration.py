"""Calibration, transforms and odometry of ROS messages as ours."""

import math
from typing import Any

import numpy as np

from common.errors import DecodeError, SourceError
from common.geometry import invert, rotation_from_quaternion, transform_from
from common.messages import F64, Odometry
from services.camera.calibration import Lens, frame_name

DISTORTIONS = {"plumb_bob": (4, 5), "rational_polynomial": (8,), "none": (0,), "": (0, 4, 5)}


def lens_of(message: Any, rectified: bool = False) -> Lens:
    """Read a sensor_msgs CameraInfo.

    Args:
        message: Of ROS 1 (fields K, D, P) or ROS 2 (k, d, p).
        rectified: The images are rectified: P holds and there is no distortion.

    Raises:
        SourceError: Its numbers cannot be used, or its distortion model is not supported.
    """
    k, d, p = (
        np.asarray(getattr(message, name, getattr(message, name.upper(), ())), np.float64)
        for name in ("k", "d", "p")
    )
    fx, fy, cx, cy = p[[0, 5, 2, 6]] if rectified and p.size == 12 and p[0] else k[[0, 4, 2, 5]]
    if not (np.all(np.isfinite([fx, fy, cx, cy, *d])) and fx > 0 and fy > 0):
        raise SourceError(
            f"CameraInfo: expected focal lengths > 0, got fx {fx}, fy {fy}, cx {cx}, cy {cy}",
            "Give the camera's calibration with options.calibration.",
        )
    coefficients = () if rectified or not np.any(d) else tuple(d.tolist())
    model = message.distortion_model.lower()
    if coefficients and len(coefficients) not in DISTORTIONS.get(model, ()):
        raise SourceError(
            f"CameraInfo: expected distortion plumb_bob or rational_polynomial, got "
            f"{len(coefficients)} numbers for {message.distortion_model!r:.40}"
        )
    return Lens(
        fx=float(fx),
        fy=float(fy),
        cx=float(cx),
        cy=float(cy),
        distortion=coefficients,
        width=int(message.width),
        height=int(message.height),
    )


class Transforms:
    """A tree of static transforms."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, F64]] = {}

    def add(self, message: Any) -> None:
        """Take a tf2_msgs TFMessage; a transform that is not one is left out."""
        for item in message.transforms:
            t, q = item.transform.translation, item.transform.rotation
            try:
                rotation = rotation_from_quaternion(q.x, q.y, q.z, q.w)
            except ValueError:
                continue
            matrix = transform_from((t.x, t.y, t.z), rotation)
            if np.all(np.isfinite(matrix)):
                child = item.child_frame_id.strip("/")
                self._parents[child] = (item.header.frame_id.strip("/"), matrix)

    def find(self, target: str, source: str) -> F64 | None:
        """Return target_from_source, None if the tree does not connect them."""
        ours, theirs = self._ancestors(source.strip("/")), self._ancestors(target.strip("/"))
        for frame, ancestor_from_source in ours.items():
            if frame in theirs:
                return invert(theirs[frame]) @ ancestor_from_source
        return None

    def _ancestors(self, frame: str) -> dict[str, F64]:
        """Return ancestor_from_frame for the frame and all above it, nearest first."""
        found = {frame: np.eye(4)}
        matrix = np.eye(4)
        while frame in self._parents:
            frame, parent_from_child = self._parents[frame]
            matrix = parent_from_child @ matrix
            if frame in found:  # a loop: not a tree
                break
            found[frame] = matrix
        return found


def odometry_of(message: Any, stamp_ns: int, sequence: int) -> Odometry:
    """Read a nav_msgs Odometry.

    Raises:
        DecodeError: Its numbers cannot be used.
    """
    pose, twist = message.pose.pose, message.twist.twist
    q = pose.orientation
    yaw_rad = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    planar = np.ix_((0, 1, 5), (0, 1, 5))
    covariance = np.array(message.pose.covariance, np.float64).reshape(6, 6)[planar]
    try:
        return Odometry(
            stamp_ns=stamp_ns,
            sequence=sequence,
            frame_id=frame_name(message.header.frame_id),
            child_frame_id=frame_name(message.child_frame_id),
            x_m=pose.position.x,
            y_m=pose.position.y,
            theta_rad=yaw_rad,
            covariance=covariance if np.any(covariance) else None,
            twist=np.array([twist.linear.x, twist.linear.y, twist.angular.z]),
        )
    except ValueError as error:
        raise DecodeError(f"odometry: {error}") from error
