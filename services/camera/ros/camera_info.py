"""Intrinsics of images from CameraInfo of ROS 1 and ROS 2."""

import re
from typing import Any

import numpy as np

from people4d.errors import SourceError
from people4d.messages import F64
from services.camera.calibration import Intrinsics, to_intrinsics
from services.camera.distortion import is_fisheye, read_distortion

# Pattern of topics of images without distortion
RECTIFIED = re.compile(r"(^|[/_])rect(ified)?([/_]|$)")


def intrinsics_of(message: Any, topic: str = "") -> Intrinsics:
    """Read the CameraInfo of a topic of images; SourceError if it is unusable.

    K and P apply to the full sensor; images may be a part of it (roi), and reduced (binning).

    Source: sensor_msgs/CameraInfo; image_geometry's PinholeCameraModel.
    """
    rectified = bool(RECTIFIED.search(topic))
    k, p, d = (_numbers(message, name) for name in "kpd")
    fx, fy, cx, cy = p[[0, 5, 2, 6]] if rectified and p.size == 12 and p[0] else k[[0, 4, 2, 5]]
    if not (np.all(np.isfinite([fx, fy, cx, cy, *d])) and fx > 0 and fy > 0):
        raise SourceError(
            f"CameraInfo: expected focal lengths > 0, got fx {fx}, fy {fy}, cx {cx}, cy {cy}",
            "Give the camera's calibration with options.calibration.",
        )
    roi, step_x, step_y = message.roi, message.binning_x or 1, message.binning_y or 1
    matrix = np.array(
        [fx / step_x, fy / step_y, (cx - roi.x_offset) / step_x, (cy - roi.y_offset) / step_y]
    )
    coefficients = () if rectified else read_distortion(message.distortion_model, d)
    width, height = roi.width or message.width, roi.height or message.height
    fisheye = is_fisheye(message.distortion_model) and not rectified
    return to_intrinsics(matrix, coefficients, width // step_x, height // step_y, fisheye)


def same_numbers(one: Any, other: Any) -> bool:
    """Check that two CameraInfo are equal except for their stamps."""
    return _compared(one) == _compared(other)


def _compared(message: Any) -> tuple[Any, ...]:
    roi = message.roi
    return (
        *(message.width, message.height, message.distortion_model),
        *(message.binning_x, message.binning_y),
        *(roi.x_offset, roi.y_offset, roi.width, roi.height),
        *(_numbers(message, name).tobytes() for name in "dkp"),
    )


def _numbers(message: Any, name: str) -> F64:
    """Return an array of the message, whose name is a capital letter in ROS 1."""
    return np.asarray(getattr(message, name, getattr(message, name.upper(), ())), np.float64)
